"""Move joints with a set point that stays slightly ahead of their positions. The motion stops when no more commands
arrive."""

from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray

HORIZON_S: Final = 0.3
"""Time by which the set point is ahead of the joints, in seconds. Each command ends at rest at the set point. The
joints therefore stop within this time after the last command, even if the operator's program has crashed.
"""
FURTHEST: Final = 0.15
"""Maximum distance of a set point from the measured joint, in rad or m. This distance limits the force on a blocked
joint.
"""
NEAR: Final = 2e-3
"""Maximum distance from its target at which a joint counts as having reached it, in rad or m."""


class JointPositions(NamedTuple):
    """Commanded and measured positions of several joints: arrays (n,), in rad or m."""

    commanded: FloatArray
    measured: FloatArray


class GuidedMotion:
    """Set point for several joints. Arrays have shape (n,), in rad or m."""

    def __init__(self, position: FloatArray, lower: FloatArray, upper: FloatArray, fastest: FloatArray) -> None:
        """Start at the commanded positions. Joints that are outside their limits can move back inside.

        Args:
            position: Commanded positions (n,), in rad or m.
            lower: Lower limits (n,), in rad or m.
            upper: Upper limits (n,), in rad or m.
            fastest: Maximum velocities (n,) of the set point, in rad/s or m/s.
        """
        self.set_point = position.copy()
        self._lower, self._upper = np.minimum(lower, position), np.maximum(upper, position)
        self._fastest = fastest

    def go(self, velocity: FloatArray, passed_s: float, at: JointPositions) -> FloatArray:
        """Advance the set point at a velocity and return it.

        The set point stays within reach of the joints. If the joints are not following because of a fault, a stop or an
        obstacle, the set point waits for them. As a result, the joints do not jump when they can follow again.

        Args:
            velocity: Velocities (n,), in rad/s or m/s.
            passed_s: Time since the last call, in seconds.
            at: Present positions of the joints.
        """
        step = np.clip(velocity, -self._fastest, self._fastest) * min(passed_s, HORIZON_S)
        reach = self._fastest * HORIZON_S
        ahead = np.clip(self.set_point + step, at.commanded - reach, at.commanded + reach)
        near = np.clip(ahead, at.measured - FURTHEST, at.measured + FURTHEST)
        self.set_point = np.clip(near, self._lower, self._upper)
        return self.set_point

    def go_to(self, target: FloatArray, passed_s: float, at: JointPositions) -> bool:
        """Advance the set point along a straight line, and return whether the commands have reached the target."""
        target = np.clip(target, self._lower, self._upper)
        way = target - self.set_point
        whole_s = float((np.abs(way) / self._fastest).max())
        self.go(way / max(whole_s, passed_s, 1e-6), passed_s, at)
        return bool((np.abs(target - at.commanded) <= NEAR).all())
