"""Move an arm slowly, for tools that have exclusive use of the bus."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import cos, pi, tau
from typing import Final, Self

import numpy as np

from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.driver_errors import DriverError
from hal.confirm import confirmed_positions
from hal.fault_timeout import FaultTimeout
from hal.gate import SafetyGate
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.servos.limp_arm import servo_name
from hal.servos.servo_hardware import ServoHardware
from hal.types import FloatArray, JointCommand, JointLimits, JointState

PERIOD_S: Final = 0.05
SPEED_SHARE: Final = 0.25
"""Maximum speed of a joint in the tools, as a fraction of its velocity limit."""
FASTEST_RAD_S: Final = 0.4
"""Default maximum speed of a servo's shaft."""
SETTLE_S: Final = 0.3
"""Time a joint must be at rest before it counts as settled, in seconds."""
STANDS_RAD: Final = 0.003
"""Maximum angle that the shaft of a servo at rest turns within ``SETTLE_S``: two counts of an STS."""
LONGEST_SETTLE_S: Final = 2.0
SINK_SHARES: Final = (0.3, 0.2, 0.12, 0.06)
"""Successive torque limits before torque is disabled, as fractions of full drive. With these limits, a raised arm sinks
instead of falling.
"""
SINK_STEP_S: Final = 0.4
"""Duration of each of these torque limits, in seconds."""
ENDED_EARLY: Final = "the torque may be on, reduced or off, so support the arm"
"""State of the arm if a tool is ended while the arm may be moved or lowered."""


class StoppedError(DriverError):
    """The user stopped the arm."""


class ServoFailedError(StoppedError):
    """A servo failed, so the arm stopped."""


class SlowArm:
    """Context manager that enables the arm's torque and moves the arm slowly.

    At exit, the arm is lowered gradually and its torque is disabled, unless ``relax`` is set to False. A second request
    to stop ends the lowering, and the torque is disabled at once. Positions are in rad or m, in the order of the
    joints.
    """

    def __init__(
        self,
        open_bus: Callable[[], Bus | Mapping[str, Bus]],
        joints: Sequence[Joint],
        clock: Clock,
        stopped: Callable[[], int] = lambda: 0,
        fastest_rad_s: float = FASTEST_RAD_S,
        period_s: float = PERIOD_S,
    ) -> None:
        """Prepare the arm without opening any bus.

        Args:
            open_bus: Function that opens the bus of the joints, or all of their buses, keyed by name.
            joints: Joints of the arm.
            clock: Clock that times the cycles.
            stopped: Function that is called in each cycle and returns the number of requests to stop. After the first
                request, StoppedError is raised and the arm is lowered gradually. After the second request, the arm is
                not lowered any further, but its torque is disabled.
            fastest_rad_s: Maximum speed of a servo's shaft, reduced to ``SPEED_SHARE`` of the joint's limit.
            period_s: Length of a cycle, in seconds.
        """
        self.joints = tuple(replace(joint, limits=_slow(joint, fastest_rad_s)) for joint in joints)
        self.period_s = period_s
        self.stopped = stopped
        self.relax = True
        """Whether torque is disabled at exit. Otherwise, the servos hold their last goals."""
        self.begun = False
        """Whether the activation has begun, so that the torque of a servo may have been enabled."""
        self.torque_left: tuple[str, ...] = ()
        """Errors of servos whose torque may still be enabled after the context has ended."""
        self.asked_s = 0.0
        """Clock time at which the latest measurement was requested."""
        self._open_bus = open_bus
        self._buses: Mapping[str, Bus] = {}
        self._clock = clock
        self._hardware = ServoHardware("arm", self.joints, self._opened, clock)
        self._gate = SafetyGate([joint.limits for joint in self.joints])
        self._state: JointState | None = None
        self._fault_timeout = FaultTimeout(self._hardware.joints)
        self.command: FloatArray = np.zeros(len(joints))
        """Current goals of the joints, shape (n,)."""

    def _opened(self) -> Mapping[str, Bus]:
        opened = self._open_bus()
        self._buses = opened if isinstance(opened, Mapping) else {self.joints[0].bus: opened}
        return self._buses

    def __enter__(self) -> Self:
        """Enable torque with every goal set to the measured position.

        After a request to stop, the torque is not changed. If torque may still be enabled after an error, the exception
        has a note. Raises StoppedError, DriverError, HalError.
        """
        self._check_stopped("the arm was not moved")
        self._hardware.configure()
        try:
            self._check_stopped("the arm was not moved")
            self.begun = True
            self._hardware.activate()
            self._state = self._hardware.read()
            names, step = self._hardware.joints, [joint.limits.velocity * self.period_s for joint in self.joints]
            self.command = confirmed_positions(
                self._state, self._hardware.read, names, range(len(names)), np.array(step)
            )
        except BaseException as error:
            try:
                active = self._hardware.state is LifecycleState.ACTIVE
                self.torque_left = tuple(self._hardware.undo_activation() if active else self._hardware.torque_left)
                if self.torque_left:
                    error.add_note(self._torque_text())
            finally:
                self._hardware.cleanup()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        """Lower the arm gradually and disable its torque.

        If torque may still be enabled, a note is added to the exception that ended the block, or to the exception that
        interrupts the lowering. If there is no exception, or if the user stopped the arm, StoppedError is raised
        instead, because the message of a stop states that the torque is off.
        """
        try:
            self._release()
        except BaseException as interrupt:
            if self.torque_left:
                interrupt.add_note(self._torque_text())
            raise
        finally:
            self._hardware.cleanup()
        if self.torque_left:
            if not isinstance(error, Exception) or type(error) is StoppedError:
                raise StoppedError(self._torque_text())
            error.add_note(self._torque_text())

    @property
    def state(self) -> JointState:
        """The latest measurement of all joints."""
        assert self._state is not None
        return self._state

    def measured(self, index: int) -> float:
        """Return the latest measured position of one joint."""
        return float(self.state.position[index])

    def measured_near(self, index: int, near: float) -> float:
        """Return the latest position of one joint, shifted by whole turns so that it is closest to ``near``.

        A servo reports only its position within one turn.
        """
        measured, turn = self.measured(index), tau * self.joints[index].transmission
        return measured + round((near - measured) / turn) * turn

    def go(self, index: int, target: float) -> None:
        """Move one joint smoothly to the target at its reduced speed, and wait up to 2 s for it to come to rest."""
        start, limits = float(self.command[index]), self.joints[index].limits
        cycles = round(0.5 * pi * abs(target - start) / limits.velocity / self.period_s) + 1
        for cycle in range(1, cycles + 1):
            self.cycle(index, start + (target - start) * 0.5 * (1.0 - cos(pi * cycle / cycles)))
        stands = STANDS_RAD * self.joints[index].transmission
        for _ in range(round(LONGEST_SETTLE_S / SETTLE_S)):
            before = self.measured(index)
            self._keep(index, target, SETTLE_S)
            if abs(self.measured(index) - before) <= stands:
                return

    def go_all(self, targets: FloatArray, after_cycle: Callable[[], None] = lambda: None) -> None:
        """Move all joints smoothly and simultaneously, at no more than ``FASTEST_RAD_S`` of each servo's shaft.

        All joints arrive at the same time. The method does not wait until the joints are at rest. Raises StoppedError.

        Args:
            targets: Goals of the joints, shape (n,).
            after_cycle: Function that is called after each cycle.
        """
        start = self.command.copy()
        fastest = [min(one.limits.velocity, FASTEST_RAD_S * one.transmission) for one in self.joints]
        seconds = 0.5 * pi * float((np.abs(targets - start) / fastest).max())
        cycles = round(seconds / self.period_s) + 1
        for cycle in range(1, cycles + 1):
            self._cycle(start + (targets - start) * 0.5 * (1.0 - cos(pi * cycle / cycles)))
            after_cycle()

    def rest(self, seconds: float) -> None:
        """Hold all joints at their current goals. Raises StoppedError."""
        self._keep(0, float(self.command[0]), seconds)

    def _keep(self, index: int, position: float, seconds: float) -> None:
        for _ in range(round(seconds / self.period_s)):
            self.cycle(index, position)

    def cycle(self, index: int, position: float) -> None:
        """Run one cycle with a new goal for one joint. The other joints keep their goals. Raises StoppedError."""
        wanted = self.command.copy()
        wanted[index] = position
        self._cycle(wanted)

    def _cycle(self, wanted: FloatArray) -> None:
        self._check_stopped("the arm's torque is disabled" if self.relax else "the arm holds its position")
        self.command = self._gate.limit(wanted, self.command, self.period_s).values
        self._hardware.write(JointCommand(self.command, self.period_s))
        self._clock.sleep_until(self._clock.now() + self.period_s)
        self.asked_s = self._clock.now()
        self._state = self._hardware.read()
        if fault := self._fault_timeout.lasting(self._state.faults, self.period_s):
            raise ServoFailedError(fault)

    def _check_stopped(self, left: str) -> None:
        """Raise StoppedError after a request to stop. ``left`` describes the state in which the arm is left."""
        if self.stopped():
            raise StoppedError(f"stopped: {left}")

    def _release(self) -> None:
        """Lower the arm gradually, disable its torque and restore its torque limits, unless the arm holds its position.

        ``torque_left`` contains all servos until the torque is disabled, in case of an interrupt.
        """
        if not self.relax:
            self._hardware.deactivate(relax=False)
            return
        self.torque_left = tuple(map(servo_name, self.joints))
        try:
            self._sink()
        finally:
            self.torque_left = tuple(self._hardware.deactivate(relax=True))
        self._restore_limits()

    def _sink(self) -> None:
        """Reduce the torque limits step by step, until the second request to stop.

        A servo that does not accept a limit keeps its torque until torque is disabled on all servos at the end.
        """
        for share in SINK_SHARES:
            for joint in self.joints:
                if self._hurried:
                    return
                try:
                    self._buses[joint.bus].limit_torque(joint.servo_id, min(share, joint.torque_limit))
                except DriverError:
                    continue
            end_s = self._clock.now() + SINK_STEP_S
            while not self._hurried and self._clock.now() < end_s:
                self._clock.sleep_until(min(self._clock.now() + self.period_s, end_s))

    @property
    def _hurried(self) -> bool:
        """Whether the user has asked to stop a second time."""
        return self.stopped() > 1

    def _restore_limits(self) -> None:
        """Write the torque limits of limp servos again.

        Otherwise, a program that enables the torque without writing a limit would hold the arm with the last limit of
        ``_sink``. Servos that do not respond are skipped.
        """
        for joint in self.joints:
            bus = self._buses[joint.bus]
            try:
                if not bus.torque_is_on(joint.servo_id):
                    bus.limit_torque(joint.servo_id, joint.torque_limit)
            except DriverError:
                continue

    def _torque_text(self) -> str:
        return "torque may still be on: " + "; ".join(self.torque_left)


def _slow(joint: Joint, fastest_rad_s: float) -> JointLimits:
    fastest = min(SPEED_SHARE * joint.limits.velocity, fastest_rad_s * joint.transmission)
    return replace(joint.limits, velocity=fastest)
