"""The arm in MuJoCo as a hardware component that has neither servos nor a bus.

A stiff, damped spring pulls each joint along the line between two commands. The maximum force of the spring is that of
the servo in the robot file. The arm's weight is compensated, just as the stack compensates it for servos. To see how
servos and their bus affect a command, use the virtual bus.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from hal.joint import Joint
from hal.lifecycle import LifecycleState, require, require_configured
from hal.types import FloatArray, JointCommand, JointState
from sim_backend.compiled import compiled
from sim_backend.scene.feeder import Feeder
from sim_backend.scene.world import World

IntArray = NDArray[np.int64]

STIFFNESS = 15.0
"""Torque per radian of shaft error, as a fraction of the stall torque. The torque is at its maximum at an error of four
degrees."""
LONGEST_CATCH_UP_S = 0.2
"""Maximum simulated time that the world catches up on after the program was delayed, in seconds."""


@compiled
def drive(
    position: FloatArray,
    velocity: FloatArray,
    effort: FloatArray,
    weight: FloatArray,
    position_at: IntArray,
    velocity_at: IntArray,
    effort_at: IntArray,
    begin: FloatArray,
    end: FloatArray,
    share: float,
    stiffness: FloatArray,
    strongest: FloatArray,
    damping: FloatArray,
) -> None:
    """Pull the joints with springs toward their set-points, which are at the fraction ``share`` between ``begin`` and
    ``end``.

    ``weight`` contains the efforts that compensate for gravity and motion, for each degree of freedom. These efforts
    are added to the spring efforts.
    """
    for i in range(len(begin)):
        error = begin[i] + (end[i] - begin[i]) * share - position[position_at[i]]
        wanted = stiffness[i] * error + weight[velocity_at[i]]
        pull = min(max(wanted, -strongest[i]), strongest[i])
        effort[effort_at[i]] = pull - damping[i] * velocity[velocity_at[i]]


class MujocoHardware:
    """A component that runs on a World and has the life cycle of hal.hardware.Hardware. The component uses the clock's
    time."""

    def __init__(self, name: str, joints: Sequence[Joint], world: World, clock: Clock) -> None:
        self.name = name
        self.joints = tuple(joint.name for joint in joints)
        self.command_interfaces = tuple(f"{joint.name}/position" for joint in joints)
        self.outputs: tuple[str, ...] = ()
        """Outputs of the component, which have no effect in the world."""
        self.state = LifecycleState.UNCONFIGURED
        self._world = world
        self._feeder = Feeder()
        self._clock = clock
        self._order = [world.joints.index(joint) for joint in self.joints]
        self._strength = np.array([j.full_effort * j.torque_limit for j in joints])
        self._full = np.array([j.full_effort for j in joints])
        ratio = np.array([j.transmission for j in joints])
        self._stiffness = self._full * STIFFNESS / ratio
        self._damping = self._full / ratio / np.array([j.model.no_load_speed_rad_s for j in joints])
        arrays = world.arrays
        self._weight: FloatArray = world.data.qfrc_bias
        self._arrays = (arrays.position, arrays.velocity, arrays.effort, self._weight)
        self._at: tuple[IntArray, IntArray, IntArray] = (
            np.array(arrays.position_at)[self._order],
            np.array(arrays.velocity_at)[self._order],
            np.array(arrays.effort_at)[self._order],
        )
        self._from = self._to = self._measured()
        self._driven = False
        self._progress_s = 0.0
        self._period_s = world.timestep_s
        self._last_s = clock.now()

    def configure(self) -> None:
        require(self.state, LifecycleState.UNCONFIGURED, "configure")
        self.state = LifecycleState.INACTIVE
        self._last_s = self._clock.now()

    def activate(self) -> None:
        require(self.state, LifecycleState.INACTIVE, "activate")
        self._from = self._to = self._measured()
        self._driven = True
        self.state = LifecycleState.ACTIVE

    def deactivate(self, relax: bool) -> Sequence[str]:
        require(self.state, LifecycleState.ACTIVE, "deactivate")
        self.state = LifecycleState.INACTIVE
        self._driven = not relax
        return []

    def cleanup(self) -> None:
        self.state = LifecycleState.UNCONFIGURED

    def read(self) -> JointState:
        """Advance the world to the current time and return the joint states."""
        require_configured(self.state, "read")
        now_s = self._clock.now()
        due_s = min(now_s - self._last_s, LONGEST_CATCH_UP_S)
        steps = round(due_s / self._world.timestep_s)
        self._last_s += steps * self._world.timestep_s + (now_s - self._last_s - due_s)
        for _ in range(steps):
            self._step()
        velocity = self._world.velocity()[self._order]
        return JointState(now_s, self._measured(), velocity, self._effort())

    def write(self, command: JointCommand) -> None:
        require(self.state, LifecycleState.ACTIVE, "write")
        self._from, self._to = self._target(), command.values.copy()
        self._progress_s, self._period_s = 0.0, command.period_s

    def _measured(self) -> FloatArray:
        position: FloatArray = self._world.position()[self._order]
        return position

    def _target(self) -> FloatArray:
        share = min(1.0, self._progress_s / self._period_s)
        target: FloatArray = self._from + (self._to - self._from) * share
        return target

    def _effort(self) -> FloatArray:
        if not self._driven:
            return np.zeros(len(self.joints))
        error = self._target() - self._measured()
        wanted = self._stiffness * error + self._weight[self._at[1]]
        drive = np.clip(wanted, -self._strength, self._strength)
        effort: FloatArray = drive - self._damping * self._world.velocity()[self._order]
        return effort

    def _step(self) -> None:
        share = min(1.0, self._progress_s / self._period_s)
        if self._driven:
            drive(*self._arrays, *self._at, self._from, self._to, share, self._stiffness, self._strength, self._damping)
        else:
            self._world.arrays.effort[:] = 0.0
        self._progress_s += self._world.timestep_s
        self._world.advance()
        self._feeder.update(self._world, self._world.time_s)
