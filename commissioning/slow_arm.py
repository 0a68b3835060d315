"""An arm under torque that moves slowly, one joint at a time: for tools, beside no other program."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import cos, pi, tau
from typing import Final, Self

import numpy as np

from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.errors import DriverError
from hal.confirm import confirmed_positions
from hal.gate import SafetyGate
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.servos.servo_hardware import ServoHardware
from hal.types import FloatArray, JointCommand, JointLimits, JointState

PERIOD_S: Final = 0.05
SPEED_SHARE: Final = 0.25
"""Of the joint's velocity limit; tools never move faster."""
FASTEST_RAD_S: Final = 0.4
"""Of a servo's shaft."""
SETTLE_S: Final = 0.3
"""So long a joint that stands has stood."""
STANDS_RAD: Final = 0.003
"""A servo's shaft that turns by less within ``SETTLE_S`` stands: two counts of an STS."""
LONGEST_SETTLE_S: Final = 2.0
PATIENCE_S: Final = 0.2
"""A packet that is lost is no reason to let the arm go, nor a machine that is held up for a moment."""
LETTING_DOWN: Final = (0.3, 0.2, 0.12, 0.06)
"""Shares of full drive on the way to none: an arm in the air sinks, and does not fall."""
LETTING_DOWN_S: Final = 0.4
"""The time at each share."""


class StoppedError(DriverError):
    """Somebody stopped the arm, or one of its servos failed."""


class SlowArm:
    """A context manager: the arm is limp behind it, unless ``relax`` is taken back. Positions in rad or m, in the order
    of the joints.
    """

    def __init__(
        self,
        open_bus: Callable[[], Bus | Mapping[str, Bus]],
        joints: Sequence[Joint],
        clock: Clock,
        stopped: Callable[[], bool] = lambda: False,
        fastest_rad_s: float = FASTEST_RAD_S,
        period_s: float = PERIOD_S,
    ) -> None:
        """``stopped`` is asked in each cycle; once it says yes, the arm is let down, and StoppedError raised.

        ``open_bus``: the joints' bus, or all of them by name. ``fastest_rad_s``: of a servo's shaft, within
        ``SPEED_SHARE`` of the joint's limit.
        """
        self.joints = tuple(replace(joint, limits=_slow(joint, fastest_rad_s)) for joint in joints)
        self.period_s = period_s
        self.stopped = stopped
        self.relax = True
        """Whether the arm is let down at the end; else its servos hold their last goals."""
        self.asked_s = 0.0
        """When the servos were asked for the newest measurement, on the clock."""
        self._open_bus = open_bus
        self._buses: Mapping[str, Bus] = {}
        self._clock = clock
        self._hardware = ServoHardware("arm", self.joints, self._opened, clock)
        self._gate = SafetyGate([joint.limits for joint in self.joints])
        self._state: JointState | None = None
        self._faulty_cycles = 0
        self.command: FloatArray = np.zeros(len(joints))
        """Where the joints are sent, (n,)."""

    def _opened(self) -> Mapping[str, Bus]:
        opened = self._open_bus()
        self._buses = opened if isinstance(opened, Mapping) else {self.joints[0].bus: opened}
        return self._buses

    def __enter__(self) -> Self:
        """Torque on, every goal at its measured position. Raises DriverError, HalError."""
        self._hardware.configure()
        try:
            self._hardware.activate()
            self._state = self._hardware.read()
            names, step = self._hardware.joints, [joint.limits.velocity * self.period_s for joint in self.joints]
            self.command = confirmed_positions(
                self._state, self._hardware.read, names, range(len(names)), np.array(step)
            )
        except BaseException:
            if self._hardware.state is LifecycleState.ACTIVE:
                self._hardware.undo_activation()
            self._hardware.cleanup()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Let the arm down and go. Raises StoppedError where torque may still be on."""
        try:
            if self.relax:
                self._let_down()
            if problems := self._hardware.deactivate(self.relax):
                raise StoppedError("torque may still be on: " + "; ".join(problems))
        finally:
            self._hardware.cleanup()

    @property
    def state(self) -> JointState:
        """The newest measurement of all joints."""
        assert self._state is not None
        return self._state

    def measured(self, index: int) -> float:
        """The newest measured position of one joint."""
        return float(self.state.position[index])

    def measured_near(self, index: int, near: float) -> float:
        """The newest position with turns, of a servo that reports its place in the turn: the nearest to ``near``."""
        measured, turn = self.measured(index), tau * self.joints[index].transmission
        return measured + round((near - measured) / turn) * turn

    def go(self, index: int, target: float) -> None:
        """Move one joint there on a smooth way at its slow speed, and wait until it stands, 2 s at most."""
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

    def go_all(self, targets: FloatArray, look: Callable[[], None] = lambda: None) -> None:
        """Move all joints there at once on a smooth way, none faster than ``FASTEST_RAD_S`` of its servo's shaft.

        ``targets``: (n,). They arrive together, and nobody waits until they stand. ``look`` is called behind each
        cycle. Raises StoppedError.
        """
        start = self.command.copy()
        fastest = [min(one.limits.velocity, FASTEST_RAD_S * one.transmission) for one in self.joints]
        seconds = 0.5 * pi * float((np.abs(targets - start) / fastest).max())
        cycles = round(seconds / self.period_s) + 1
        for cycle in range(1, cycles + 1):
            self._cycle(start + (targets - start) * 0.5 * (1.0 - cos(pi * cycle / cycles)))
            look()

    def rest(self, seconds: float) -> None:
        """Hold all joints where they were sent. Raises StoppedError."""
        self._keep(0, float(self.command[0]), seconds)

    def _keep(self, index: int, position: float, seconds: float) -> None:
        for _ in range(round(seconds / self.period_s)):
            self.cycle(index, position)

    def cycle(self, index: int, position: float) -> None:
        """One cycle in which one joint is sent to a position, and the others stay. Raises StoppedError."""
        wanted = self.command.copy()
        wanted[index] = position
        self._cycle(wanted)

    def _cycle(self, wanted: FloatArray) -> None:
        if self.stopped():
            raise StoppedError("stopped: the arm is limp" if self.relax else "stopped: the arm holds")
        self.command = self._gate.limit(wanted, self.command, self.period_s).values
        self._hardware.write(JointCommand(self.command, self.period_s))
        self._clock.sleep_until(self._clock.now() + self.period_s)
        self.asked_s = self._clock.now()
        self._state = self._hardware.read()
        self._faulty_cycles = self._faulty_cycles + 1 if self._state.faults else 0
        if self._faulty_cycles > round(PATIENCE_S / self.period_s):
            raise StoppedError("; ".join(fault.text for fault in self._state.faults.values()))

    def _let_down(self) -> None:
        """Take the torque back step by step; a servo that does not take it is let go with the others in the end."""
        for share in LETTING_DOWN:
            for joint in self.joints:
                try:
                    self._buses[joint.bus].limit_torque(joint.servo_id, min(share, joint.torque_limit))
                except DriverError:
                    continue
            self._clock.sleep_until(self._clock.now() + LETTING_DOWN_S)


def _slow(joint: Joint, fastest_rad_s: float) -> JointLimits:
    fastest = min(SPEED_SHARE * joint.limits.velocity, fastest_rad_s * joint.transmission)
    return replace(joint.limits, velocity=fastest)
