"""Invariants on command changes: acceleration, jerk and NaN."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.waypoints import BoolArray
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

LATE: Final = 1.5
"""Number of periods after which a cycle counts as late."""
SHARE: Final = 1.02
"""Tolerance factor on a limit, for derivatives computed from differences of the sampled reference."""
STOP_JERK_SHARE: Final = 3.0
"""Allowed jerk of a stop or of a speed change on a path, as a multiple of the limit. The path's jerk adds to the jerk
of braking."""
RELIEF_SHARE: Final = 2.0
"""Allowed acceleration if joints are relieved, as a multiple of the limit. Commands lead the reference by
the servo lag."""
COMMANDS_SHARE: Final = 1.05
"""Allowed acceleration if joints are not relieved, as a multiple of the limit.

A command applies to the end of its period.
"""
AT_END: Final = 1e-9
"""Maximum distance from a limit at which a command counts as at the limit, in rad or m."""
FASTEST_PARKING: Final = 1.05
"""Allowed speed of a parking joint, as a multiple of its scaled velocity limit."""
ROUNDING: Final = 1e-6
"""Increase of a command's change per cycle that is ignored as a rounding error, in rad or m."""
UPSET_S: Final = 3.0
"""Duration after a controller's fault during which only the speed of commands is limited, in seconds."""
RELIEVED_S: Final = 0.5
"""Duration after the relief of a deactivated controller during which its commands may still change, in seconds."""


class SmoothReference(Invariant):
    """The reference of a jerk-limited trajectory controller stays within the limits of velocity, acceleration and jerk.

    The limits apply to motions and to stops. Late cycles are skipped, because the reference advances by up to two
    periods in a late cycle.
    """

    name = "smooth reference"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        limits = [stack.loop.limits[self.commanded.index(joint)] for joint in arm.joints]
        self._acceleration = np.array([limit.acceleration for limit in limits])
        self._jerk = np.array([limit.jerk for limit in limits])
        self._velocity = np.array([limit.velocity for limit in limits])
        self._references = deque[FloatArray](maxlen=4)
        self._stops = deque[bool](maxlen=4)
        self._times = deque[float](maxlen=4)

    def on_state(self, state: JointState) -> None:
        arm, tracking = self.arm, self.arm.tracking
        waits = all(joint in state.faults for joint in arm.joints)  # The reference waits until a joint responds.
        late = state.stamp_s - self._times[-1] > LATE * self.stack.loop.period_s if self._times else False
        if tracking is None or waits or late or arm.parameters.interpolation_method != "ruckig":
            self._times.clear()
            self._references.clear()
            self._stops.clear()
        if tracking is None or waits:
            return
        self._times.append(state.stamp_s)
        self._references.append(tracking.reference.position)
        self._stops.append(not tracking.on_goal or tracking.rate != 1.0)
        if len(self._references) == 4:
            self.examined += 1
            times, references = list(self._times), np.array(self._references)
            self._compare("a velocity", divided(references[2:], times[2:]), self._velocity)
            self._compare("an acceleration", divided(references[1:], times[1:]), self._acceleration)
            most = STOP_JERK_SHARE if any(self._stops) else 1.0
            self._compare("a jerk", divided(references, times), most * self._jerk)

    def _compare(self, quantity: str, value: FloatArray, limits: FloatArray) -> None:
        shares = np.abs(value) / limits
        worst = int(shares.argmax())
        if shares[worst] > SHARE:
            found = f"{shares[worst] * limits[worst]:.1f}, but its limit is {limits[worst]:.1f}"
            self.say(f"the reference of {self.arm.joints[worst]} has {quantity} of {found}")


def divided(values: FloatArray, times_s: Sequence[float]) -> FloatArray:
    """Return the mean derivative of order m - 1, computed from m sampled values.

    Args:
        values: Samples, shape (m, n).
        times_s: Times of the samples, length m.

    Returns:
        Derivative, shape (n,).
    """
    order = 1
    while len(values) > 1:
        values = np.array(
            [order * (values[i + 1] - values[i]) / (times_s[i + order] - times_s[i]) for i in range(len(values) - 1)]
        )
        order += 1
    derivative: FloatArray = values[0]
    return derivative


class SmoothEnd(Invariant):
    """While the program ends, every joint stops and parks within its acceleration limit.

    After the stop, no joint moves faster than the velocity scale for parking allows.

    A joint that has lost its controller also stops within its acceleration limit, even if another controller claims it
    before it is at rest.

    Commands are not checked after a faulty controller has made them jump, because only their speed is limited. Commands
    of limp joints are not checked either, because they follow the falling joints. Commands are also not checked while
    no joint of an arm is measured. The commands then stay constant, and the servos come to rest by themselves. A
    command leads its reference by the servo lag. A command at a joint limit is not checked, because it stays at the
    limit while the reference is still braking before the limit.
    """

    name = "smooth end"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._acceleration = np.array([limit.acceleration for limit in stack.loop.limits])
        self._ends = np.array([(limit.lower, limit.upper) for limit in stack.loop.limits]).T
        self._commands, self._times = deque[FloatArray](maxlen=3), deque[float](maxlen=3)
        self._upset_s = -math.inf
        """Time of the latest cycle in which a controller had a fault."""
        self._relieved_s = -math.inf
        """Time of the latest cycle in which a deactivated controller relieved its joints."""
        park = stack.files.robot.file.park
        scale = park.velocity_scale if park is not None else 1.0
        self._stopping = np.zeros(len(self.commanded), dtype=np.bool_)
        """Joints (n,) that had no controller in the previous cycle, or were not at rest."""
        self._park_speed = scale * np.array([limit.velocity for limit in stack.loop.limits])
        """Largest speed of each command while the arm parks, in rad/s or m/s."""

    def on_command(self, values: FloatArray) -> None:
        now_s = self.stack.clock.now()
        if self.upset:
            self._upset_s = now_s
        if any(entry.begun for entry in self.stack.manager.cycle.leaving.entries):
            self._relieved_s = now_s
        seen = self.stack.manager.cycle.seen
        if seen is None or not self.active or now_s - self._upset_s < UPSET_S or self._waits(seen):
            self._commands.clear()
            return
        if self._commands and not np.array_equal(self._commands[-1], self.stack.loop.previous_command):
            self._commands.clear()  # Joints were taken over.
        self._commands.append(values.copy())  # The last commands before the end show how fast each joint was moving.
        self._times.append(seen.stamp_s)
        before, self._stopping = self._stopping, self._stopping_now()
        examined = self._stopping | before
        if any(examined) and len(self._commands) == 3:
            self.examined += 1
            change = self._acceleration_now()
            limp = {joint.name for joint in self.joints if not self.torque(joint)}
            change[[name in limp for name in self.commanded]] = 0.0
            change[(np.abs(values - self._ends) < AT_END).any(axis=0)] = 0.0
            change[~examined] = 0.0
            worst = int((change / self._acceleration).argmax())
            parks = self.stack.ending and self.stack.control_stack.releases
            relieved = now_s - self._relieved_s <= RELIEVED_S
            if change[worst] > (RELIEF_SHARE if relieved else COMMANDS_SHARE) * self._acceleration[worst]:
                found = f"{change[worst]:.1f}, but its limit is {self._acceleration[worst]:.1f}"
                self.say(f"{self.commanded[worst]} stops or parks with an acceleration of {found}")
            if parks:
                self._examine_speed()

    def _acceleration_now(self) -> FloatArray:
        """Return the magnitudes of the accelerations (n,) of the last commands.

        Stops and parking motions advance by one period per cycle, but relieved joints advance by the time between
        states.
        """
        period_s, commands = self.stack.loop.period_s, np.array(self._commands)
        change: FloatArray = np.abs(divided(commands, (0.0, period_s, 2.0 * period_s)))
        if np.diff(self._times).min() > 0.0:
            change = np.minimum(change, np.abs(divided(commands, list(self._times))))
        return change

    def _stopping_now(self) -> BoolArray:
        """Return which joints (n,) have no controller, or are not at rest from the motion of another controller."""
        manager, interfaces = self.stack.manager, self.stack.loop.hardware.command_interfaces
        claimed = manager.registry.claimed
        free = [self.stack.ending or one not in claimed for one in interfaces]
        if manager.stops.moving or manager.cycle.leaving.entries:
            free = [one or not manager.cycle.at_rest([place]) for place, one in enumerate(free)]
        return np.array(free)

    def _waits(self, seen: JointState) -> bool:
        """Return whether no joint of an arm is measured."""
        return any(seen.faults.keys() >= set(arm.joints) for arm in self.stack.arms)

    def _examine_speed(self) -> None:
        """Check that no command changes faster than in a parking motion, unless it slows down."""
        before, now = np.abs(np.diff(np.array(self._commands), axis=0)) / self.stack.loop.period_s
        fast = (now > FASTEST_PARKING * self._park_speed) & (now > before + ROUNDING / self.stack.loop.period_s)
        if fast.any():
            place = int(np.flatnonzero(fast)[0])
            speeds = f"{now[place]:.2f}, but at most {self._park_speed[place]:.2f}"
            self.say(f"{self.commanded[place]} parks at a speed of {speeds} is allowed")


class NanHolds(Invariant):
    """While a controller commands NaN, its joints hold their position: their commands do not change.

    A joint outside its limits moves back to its limits.
    A controller commands its joints only after they have come to rest from the motion of another controller.
    """

    name = "nan holds"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._names = list(stack.loop.hardware.command_interfaces)
        self._held: dict[int, float] = {}

    def on_state(self, state: JointState) -> None:
        loop = self.stack.loop
        places = [
            self._names.index(interface)
            for name, controller in self.stack.controllers.items()
            if self.stack.manager.registry.loaded[name].active and any(how == "nan" for how, _ in controller.upsets)
            for interface in controller.command_interfaces
        ]
        resting = [place for place in places if self.active and self.stack.manager.cycle.at_rest([place])]
        held = {place: float(loop.command[place]) for place in resting}
        held = {place: at for place, at in held.items() if loop.limits[place].lower <= at <= loop.limits[place].upper}
        for place in held.keys() & self._held.keys():
            self.examined += 1
            if held[place] != self._held[place]:
                self.say(
                    f"{self._names[place]} changes from {self._held[place]} to {held[place]} although NaN is commanded"
                )
        self._held = held
