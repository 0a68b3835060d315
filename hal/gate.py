"""The safety gate: the last word before the hardware. It does not trust the controllers.

Pure: command in, command out. What comes out is finite, within the position limits, and no further
from the last output than the joint may travel in one period.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hal.types import FloatArray, JointLimits


@dataclass(frozen=True, slots=True)
class Gated:
    """``position`` of shape (n,), safe; ``reasons`` says for each changed joint index why."""

    position: FloatArray
    reasons: dict[int, str]


class SafetyGate:
    """Limits for n joints, in joint order (rad, m, and per second)."""

    def __init__(self, limits: Sequence[JointLimits]) -> None:
        self._lower = np.array([limit.lower for limit in limits])
        self._upper = np.array([limit.upper for limit in limits])
        self._velocity = np.array([limit.velocity for limit in limits])

    def limit(self, wanted: FloatArray, last: FloatArray, period_s: float) -> Gated:
        """``wanted`` made safe; ``last`` is what the gate let through before (shape (n,))."""
        finite = np.where(np.isfinite(wanted), wanted, last)
        inside = np.clip(finite, self._lower, self._upper)
        reach = self._velocity * period_s
        safe = np.clip(inside, last - reach, last + reach)
        # A command that follows the limit exactly differs from it by rounding only.
        if not np.abs(safe - wanted).max(initial=0.0) <= 1e-9:  # NaN is not smaller either
            return Gated(safe, self._reasons(wanted, inside, safe))
        return Gated(safe, {})

    def _reasons(self, wanted: FloatArray, inside: FloatArray, safe: FloatArray) -> dict[int, str]:
        reasons: dict[int, str] = {}
        for i, value in enumerate(wanted):
            if not np.isfinite(value):
                reasons[i] = f"the command is {value}: holding"
            elif abs(inside[i] - value) > 1e-9:
                reasons[i] = f"{value:.4f} is outside the limits {self._lower[i]:.4f} to {self._upper[i]:.4f}"
            elif not abs(safe[i] - value) <= 1e-9:
                reasons[i] = f"{value:.4f} is too far for one period: going to {safe[i]:.4f}"
        return reasons
