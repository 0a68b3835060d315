"""The check of a calibration: each joint moves a little under torque, slowly, and comes to where it was sent."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import cos, pi
from typing import Final

import numpy as np

from commissioning.calibrate.result import CalibrationError
from drivers.bus.bus import Bus
from drivers.clock import Clock
from hal.gate import SafetyGate
from hal.joint import Joint
from hal.servo_hardware import ServoHardware
from hal.types import FloatArray, JointCommand, JointLimits, JointState

PERIOD_S: Final = 0.05
WAY_RAD: Final = 0.2
"""How far each servo turns, there and back."""
SPEED_SHARE: Final = 0.25
"""Of the joint's velocity limit; tools never move faster."""
FASTEST_RAD_S: Final = 0.4
SETTLE_S: Final = 0.4
PATIENCE_CYCLES: Final = 4
"""A packet that is lost is no reason to let the arm go."""
OFF_SHARE: Final = 0.3
"""Sag is the same at both ends of the way; so much of it may be missing by friction and dead band."""


class SlowMove:
    """Moves joints one by one under torque. A context manager: torque is off before it and behind it."""

    def __init__(self, open_bus: Callable[[], Bus], joints: Sequence[Joint], clock: Clock) -> None:
        # What moves the arm here is slow, whatever the URDF allows.
        self._joints = tuple(replace(joint, limits=_slow(joint)) for joint in joints)
        self._clock = clock
        self._hardware = ServoHardware("arm", self._joints, open_bus, clock)
        self._gate = SafetyGate([joint.limits for joint in self._joints])
        self._command: FloatArray = np.zeros(len(joints))
        self._state: JointState | None = None
        self._faulty_cycles = 0

    def __enter__(self) -> "SlowMove":
        self._hardware.configure()
        try:
            self._hardware.activate()
            self._state = self._hardware.read()
        except BaseException:
            self._hardware.cleanup()
            raise
        self._command = self._state.position.copy()
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if problems := self._hardware.deactivate(relax=True):
                raise CalibrationError("torque may still be on: " + "; ".join(problems))
        finally:
            self._hardware.cleanup()

    def check(self, say: Callable[[str], None]) -> None:
        """Move every joint there and back. Raises CalibrationError with the joint that does not follow."""
        for index, joint in enumerate(self._joints):
            say(f"{joint.name} moves")
            self._there_and_back(index, joint)

    def _there_and_back(self, index: int, joint: Joint) -> None:
        start, before = float(self._command[index]), self._measured(index)
        middle = 0.5 * (joint.limits.lower + joint.limits.upper)
        way = WAY_RAD * joint.transmission * (1.0 if start < middle else -1.0)
        way = max(-abs(middle - start), min(way, abs(middle - start))) or way
        self._go(index, start + way)
        moved = self._measured(index) - before
        self._go(index, start)
        if abs(moved - way) > OFF_SHARE * abs(way):
            raise CalibrationError(
                f"{joint.name} (servo {joint.servo_id}) was to move by {way:+.3f} and moved by {moved:+.3f}: "
                "is something in its way, is it at a stop, or is its calibration wrong?"
            )

    def _go(self, index: int, target: float) -> None:
        """Move one joint there on a smooth way at its slow speed, and wait until it has settled."""
        start, limits = float(self._command[index]), self._joints[index].limits
        duration_s = max(0.5 * pi * abs(target - start) / limits.velocity, PERIOD_S)
        cycles = round(duration_s / PERIOD_S) + 1
        for cycle in range(1, cycles + 1):
            self._cycle(index, start + (target - start) * 0.5 * (1.0 - cos(pi * cycle / cycles)))
        for _ in range(round(SETTLE_S / PERIOD_S)):
            self._cycle(index, target)

    def _cycle(self, index: int, position: float) -> None:
        wanted = self._command.copy()
        wanted[index] = position
        self._command = self._gate.limit(wanted, self._command, PERIOD_S).values
        self._hardware.write(JointCommand(self._command, PERIOD_S))
        self._clock.sleep_until(self._clock.now() + PERIOD_S)
        self._state = self._hardware.read()
        self._faulty_cycles = self._faulty_cycles + 1 if self._state.faults else 0
        if self._faulty_cycles > PATIENCE_CYCLES:
            raise CalibrationError("; ".join(fault.text for fault in self._state.faults.values()))

    def _measured(self, index: int) -> float:
        assert self._state is not None
        return float(self._state.position[index])


def _slow(joint: Joint) -> JointLimits:
    fastest = min(SPEED_SHARE * joint.limits.velocity, FASTEST_RAD_S * joint.transmission)
    return replace(joint.limits, velocity=fastest)
