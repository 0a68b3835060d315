"""Find a stop of a joint: drive the joint with low torque until it stops moving although its goal is further ahead."""

from typing import Final

from commissioning.commissioning_errors import CalibrationError
from commissioning.slow_arm import PERIOD_S, SlowArm
from hal.joint import Joint

SEEK_RAD_S: Final = 0.3
"""Speed at which the goal moves during the search, in rad/s of the servo's shaft."""
STAND_RAD: Final = 0.01
"""Maximum motion within ``STAND_S`` of a servo that counts as at rest, in rad."""
STAND_S: Final = 0.4
AHEAD_RAD: Final = 0.1
"""Minimum distance between a servo at a stop and the goal ahead of it, in rad. Friction alone cannot hold the servo
this far from its goal."""


class StopSearch:
    """Motion of one joint to one of its stops."""

    def __init__(self, arm: SlowArm, index: int, joint: Joint, way: int) -> None:
        """Prepare the search. ``way`` is 1 toward larger counts and -1 toward smaller counts."""
        self._arm = arm
        self._index = index
        self._joint = joint
        self._way = way

    def run(self) -> float:
        """Return the joint's position at the stop, and set its goal to that position.

        Raises CalibrationError if there is no stop.
        """
        last = self._position(float(self._arm.command[self._index]))
        stood_s = 0.0
        while stood_s < STAND_S or self._ahead(last) < AHEAD_RAD * self._joint.transmission:
            self._step()
            now = self._position(last)
            stood_s = stood_s + PERIOD_S if abs(now - last) <= STAND_RAD * self._joint.transmission else 0.0
            last = now if stood_s == 0.0 else last
        now = self._position(last)
        self._arm.go(self._index, now)
        return now

    def _step(self) -> None:
        target = float(self._arm.command[self._index]) + self._way * SEEK_RAD_S * self._joint.transmission * PERIOD_S
        if abs(target) >= self._arm.joints[self._index].limits.upper:
            raise CalibrationError(
                f"{self._joint.name} (servo {self._joint.servo_id}) moved by {abs(target):.2f} without finding a stop: "
                "calibrate this joint by hand"
            )
        self._arm.cycle(self._index, target)

    def _ahead(self, position: float) -> float:
        return (float(self._arm.command[self._index]) - position) * self._way

    def _position(self, near: float) -> float:
        return self._arm.measured_near(self._index, near)
