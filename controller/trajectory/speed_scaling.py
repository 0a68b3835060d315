"""Scale the speed of a path as requested on ``~/speed_scaling_input``, within the acceleration limits."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.motion import Kinematics
from hal.types import FloatArray, JointLimits

SHARE: Final = 0.5
"""Fraction of the remaining acceleration that a speed change may use. Lag compensation also needs some of the
acceleration."""
FASTEST: Final = 5.0
"""Maximum change of the factor, per second."""


class SpeedScaling:
    """Speed scaling factor: 0 pauses a path, and 1 runs it at its planned speed. Any thread may call ``ask``."""

    def __init__(self, limits: Sequence[JointLimits], initial: float = 1.0) -> None:
        self.asked = min(initial, 1.0)
        self.factor = self.asked
        self._acceleration = np.array([limit.acceleration for limit in limits])

    def ask(self, factor: float) -> str | None:
        """Request a factor. Return None, or the reason why the factor is ignored or limited."""
        if not (math.isfinite(factor) and factor >= 0.0):
            return (
                f"the speed scaling factor must be 0 (pause) to 1 (the speed of the goal), not {factor}: "
                "the value is ignored"
            )
        self.asked = min(factor, 1.0)
        if factor > 1.0:
            return f"the speed scaling factor {factor} counts as 1, because a goal never runs faster than its own times"
        return None

    def idle(self) -> None:
        """Apply the requested factor immediately, because no path is active."""
        self.factor = self.asked

    def restart(self, moving: bool) -> None:
        """Start a new path. If the joints are moving, the path already has the right speed for a factor of 1."""
        self.factor = 1.0 if moving else self.asked

    def advance(self, reference: Kinematics, step_s: float) -> None:
        """Move the factor toward the requested factor for one cycle. ``reference`` is unscaled (factor 1)."""
        rate = min(SHARE * self._room(reference, step_s), FASTEST) * step_s
        self.factor += float(np.clip(self.asked - self.factor, -rate, rate))

    def _room(self, reference: Kinematics, step_s: float) -> float:
        """Return the rate (1/s) at which the factor may change within the acceleration limits.

        When the factor changes at this rate, each joint accelerates by its velocity times the rate, in addition to the
        path's own acceleration. The rate is never 0, so that even a path at its acceleration limit can be paused.
        (Linear splines in ros2_control have unlimited velocity steps anyway.)
        """
        direction = math.copysign(1.0, self.asked - self.factor) * np.sign(reference.velocity)
        own = reference.acceleration * self.factor**2 * direction
        soon = reference.velocity + reference.acceleration * step_s  # The command is already one step ahead.
        speed = np.maximum(np.abs(reference.velocity), np.abs(soon))
        left = np.clip(self._acceleration - own, 0.1 * self._acceleration, self._acceleration)
        return float((left / np.maximum(speed, 1e-9)).min())


def scaled(state: Kinematics, factor: float) -> Kinematics:
    """Return the kinematics of a state on a path when time passes ``factor`` times as fast."""
    if factor == 1.0:
        return state
    velocity: FloatArray = state.velocity * factor
    return Kinematics(state.position, velocity, state.acceleration * factor**2)
