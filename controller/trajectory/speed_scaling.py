"""Speed scaling: how fast time passes on a path, as ``~/speed_scaling_input`` asks, within the acceleration limits."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.motion import Kinematics
from hal.types import FloatArray, JointLimits

SHARE: Final = 0.5
"""The share of the acceleration that the path leaves: the lead that makes up for the servos' lag takes some too."""
FASTEST: Final = 5.0
"""The factor changes by at most so much a second."""


class SpeedScaling:
    """A factor: 0 stands still, 1 is the goal's own time. ``ask`` may be called from any thread."""

    def __init__(self, limits: Sequence[JointLimits], initial: float = 1.0) -> None:
        self.asked = min(initial, 1.0)
        self.factor = self.asked
        self._acceleration = np.array([limit.acceleration for limit in limits])

    def ask(self, factor: float) -> str | None:
        """Returns why it is ignored, or None."""
        if not (math.isfinite(factor) and factor >= 0.0):
            return f"speed scaling factor {factor} ignored: send 0 (pause) to 1 (the goal's own time)"
        self.asked = min(factor, 1.0)
        if factor > 1.0:
            return f"speed scaling factor {factor} counts as 1: goals have their own times, and limits end above them"
        return None

    def idle(self) -> None:
        """No path is scaled now: the factor is at once what was asked."""
        self.factor = self.asked

    def restart(self, moving: bool) -> None:
        """A new path begins; one that begins in movement has that movement's speed at factor 1."""
        self.factor = 1.0 if moving else self.asked

    def advance(self, reference: Kinematics, step_s: float) -> None:
        """Bring the factor one cycle nearer to what was asked; ``reference`` is the path's own, at factor 1."""
        rate = min(SHARE * self._room(reference, step_s), FASTEST) * step_s
        self.factor += float(np.clip(self.asked - self.factor, -rate, rate))

    def _room(self, reference: Kinematics, step_s: float) -> float:
        """The rate at which the factor may change (1/s): velocity times that is acceleration, on top of the path's own.

        Never 0: a pause must come, if slowly, on a path that uses all acceleration (upstream's linear splines
        have unlimited steps anyway).
        """
        way = math.copysign(1.0, self.asked - self.factor) * np.sign(reference.velocity)
        own = reference.acceleration * self.factor**2 * way
        soon = reference.velocity + reference.acceleration * step_s  # where the command is already
        speed = np.maximum(np.abs(reference.velocity), np.abs(soon))
        left = np.clip(self._acceleration - own, 0.1 * self._acceleration, self._acceleration)
        return float((left / np.maximum(speed, 1e-9)).min())


def scaled(state: Kinematics, factor: float) -> Kinematics:
    """The movement of a path's state where time passes ``factor`` times as fast."""
    if factor == 1.0:
        return state
    velocity: FloatArray = state.velocity * factor
    return Kinematics(state.position, velocity, state.acceleration * factor**2)
