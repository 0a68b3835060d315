"""The search for a joint's stop: the joint is driven softly until it stands although its goal is ahead."""

from typing import Final

from commissioning.calibrate.result import CalibrationError
from commissioning.slow_arm import PERIOD_S, SlowArm
from hal.joint import Joint

SEEK_RAD_S: Final = 0.3
STAND_RAD: Final = 0.01
"""A servo that turns by less in ``STAND_S`` stands."""
STAND_S: Final = 0.4
AHEAD_RAD: Final = 0.1
"""So far its goal must be ahead of a servo that stands for it to be at a stop: friction alone does not hold it then."""


class StopSearch:
    """The way of one joint to one stop."""

    def __init__(self, arm: SlowArm, index: int, joint: Joint, way: int) -> None:
        """``way``: 1 toward greater counts, -1 toward smaller ones."""
        self._arm = arm
        self._index = index
        self._joint = joint
        self._way = way

    def run(self) -> float:
        """Find the joint's position at the stop, from where it began; its goal is taken back to there.

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
                f"{self._joint.name} (servo {self._joint.servo_id}) turned {abs(target):.2f} and found no stop: "
                "calibrate it by hand"
            )
        self._arm.cycle(self._index, target)

    def _ahead(self, position: float) -> float:
        return (float(self._arm.command[self._index]) - position) * self._way

    def _position(self, near: float) -> float:
        return self._arm.measured_near(self._index, near)
