"""Let commands approach a goal that may jump, within the velocity and acceleration limits of the joints."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hal.types import FloatArray, JointLimits

ROUNDING: Final = 1e-9
"""Maximum distance from its goal at which a command counts as having reached the goal, in rad or m."""


class Approach:
    """Commands of n joints. A command never overshoots its goal, unless the goal comes closer than the joint's braking
    distance.

    A goal that a joint at rest can reach in one period is commanded immediately. A command stays far enough behind a
    moving goal for the joint to brake, because any goal may be the last.
    """

    def __init__(self, limits: Sequence[JointLimits]) -> None:
        self._fastest = np.array([limit.velocity for limit in limits])
        self._acceleration = np.array([limit.acceleration for limit in limits])
        self.command: FloatArray = np.full(len(limits), np.nan)
        """Last commands (n,), in rad or m."""
        self._velocity = np.zeros(len(limits))

    def begin(self, command: FloatArray) -> None:
        """Start at ``command`` (n,), at rest."""
        self.command, self._velocity = command.copy(), np.zeros(len(command))

    def resting_points(self, period_s: float) -> FloatArray:
        """Return the positions (n,) at which the joints come to rest if they start braking in the coming period."""
        change = self._acceleration * period_s
        speed = np.abs(self._velocity)
        braking = np.floor(speed / change)
        way = period_s * (braking * speed - change * braking * (braking + 1.0) / 2.0)
        points: FloatArray = self.command + np.copysign(way, self._velocity)
        return points

    def step(self, goal: FloatArray, period_s: float, share: FloatArray | float = 1.0) -> FloatArray:
        """Return the commands (n,) for the end of the next period.

        Args:
            goal: Goals (n,) within the limits, in rad or m.
            period_s: Duration of the period, in seconds.
            share: Fractions (n,) of the velocity limits that may be used.
        """
        if not self._velocity.any() and (goal == self.command).all():
            return self.command
        change = self._acceleration * period_s
        room = np.abs(goal - self.command)
        speed = np.minimum(_arriving(room, change, period_s), share * self._fastest)
        wanted = np.copysign(speed, goal - self.command)
        velocity = np.clip(wanted, self._velocity - change, self._velocity + change)
        command = self.command + velocity * period_s
        command = np.where(np.abs(goal - command) <= ROUNDING, goal, command)
        self._velocity = (command - self.command) / period_s
        self.command = command
        return command


def _arriving(room: FloatArray, change: FloatArray, period_s: float) -> FloatArray:
    """Return the speeds (n,) from which joints come to rest within ``room`` if they brake in every later period.

    With m braking periods, a joint travels ``period_s * ((m + 1) * speed - m * (m + 1) / 2 * change)``.

    Args:
        room: Distances (n,) to the goals, in rad or m.
        change: Maximum changes (n,) in speed during one period, in rad/s or m/s.
        period_s: Duration of a period, in seconds.
    """
    braking = np.maximum(np.ceil((np.sqrt(1.0 + 8.0 * room / (change * period_s)) - 3.0) / 2.0), 0.0)
    speeds: FloatArray = room / (period_s * (braking + 1.0)) + change * braking / 2.0
    return speeds
