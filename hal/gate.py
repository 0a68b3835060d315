"""Check every command before it reaches the hardware. The safety gate does not trust the controllers.

The gate has no side effects. Its output is finite and within the limits. A position differs from the previous one by
no more than the joint may travel in one period. A joint that begins outside its limits returns at a tenth of that
speed. A velocity changes no faster than the joint may accelerate, and no joint moves faster toward the end of its
range than it can brake before it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hal.types import FloatArray, JointLimits, apart, beyond_range

RETURN_SHARE: Final = 0.1
"""Share of its velocity limit at which a joint returns from outside its limits."""


@dataclass(frozen=True, slots=True)
class Gated:
    """Result of the safety gate."""

    values: FloatArray
    """Safe values of shape (m,)."""
    reasons: dict[int, str]
    """Reason of each changed value, by index."""


class SafetyGate:
    """Limiter for the commands of m command interfaces (rad, m, N m, N, and per second).

    Args:
        limits: Limits of the joint of each interface.
        kinds: Kind of each interface: "position" (the default), "velocity" or "effort".
    """

    def __init__(self, limits: Sequence[JointLimits], kinds: Sequence[str] | None = None) -> None:
        kinds = kinds or ["position"] * len(limits)
        bounds = [_bounds(kind, limit) for kind, limit in zip(kinds, limits, strict=True)]
        self._lower, self._upper, self._rate = (np.array([bound[i] for bound in bounds]) for i in range(3))
        self._held = np.array([kind == "position" for kind in kinds], dtype=bool)
        self._speeds = [i for i, kind in enumerate(kinds) if kind == "velocity"]
        self._ends = np.array([(limits[i].lower, limits[i].upper) for i in self._speeds]).reshape(-1, 2)

    def limit(self, wanted: FloatArray, last: FloatArray, period_s: float, measured: FloatArray | None = None) -> Gated:
        """Limit a command.

        Args:
            wanted: Command of shape (m,).
            last: Previous output of the gate, of shape (m,).
            period_s: Duration of the period, in seconds.
            measured: Measured position of each interface's joint, of shape (m,); NaN if it is unknown. Only needed
                for velocity commands.

        Returns:
            The safe values, and the reason for each change.
        """
        finite = np.where(np.isfinite(wanted), wanted, np.where(self._held, last, 0.0))
        inside = np.clip(finite, self._lower, self._upper)
        if self._speeds and measured is not None:
            inside[self._speeds] = self._braked(inside, period_s, measured[self._speeds])
        reach = self._rate * period_s
        outside = self._held & ((last < self._lower) | (last > self._upper))
        if outside.any():
            reach = np.where(outside, RETURN_SHARE * reach, reach)
        safe = np.clip(inside, last - reach, last + reach)
        # A command that follows the limit exactly differs from it by rounding only.
        if not np.abs(safe - wanted).max(initial=0.0) <= 1e-9:  # NaN is not smaller either
            returning = {i: f"{self._outside(i, last[i])}: returning slowly" for i in np.flatnonzero(outside).tolist()}
            return Gated(safe, self._reasons(wanted, inside, safe) | returning)
        return Gated(safe, {})

    def _braked(self, wanted: FloatArray, period_s: float, measured: FloatArray) -> FloatArray:
        """Limit velocities so that one period later the joint still has enough range left to brake."""
        rate = self._rate[self._speeds]
        room = np.stack([measured - self._ends[:, 0], self._ends[:, 1] - measured])
        down, up = _brakable(np.maximum(room, 0.0), rate, period_s)
        speeds: FloatArray = np.where(
            np.isnan(measured), wanted[self._speeds], np.clip(wanted[self._speeds], -down, up)
        )
        return speeds

    def _reasons(self, wanted: FloatArray, inside: FloatArray, safe: FloatArray) -> dict[int, str]:
        reasons: dict[int, str] = {}
        for i, value in enumerate(wanted):
            if not np.isfinite(value):
                reasons[i] = f"the command is {value}: {'holding' if self._held[i] else 'stopping'}"
            elif abs(inside[i] - value) > 1e-9 and self._lower[i] <= value <= self._upper[i]:
                said, going = apart(value, safe[i])
                reasons[i] = f"{said} is too fast so near to the end of the joint's range: going at {going}"
            elif abs(inside[i] - value) > 1e-9:
                reasons[i] = self._outside(i, value)
            elif not abs(safe[i] - value) <= 1e-9:
                reasons[i] = "{} is too far for one period: going to {}".format(*apart(value, safe[i]))
        return reasons

    def _outside(self, i: int, value: float) -> str:
        return "{} is outside the limits {} to {}".format(*beyond_range(value, self._lower[i], self._upper[i]))


def _bounds(kind: str, limit: JointLimits) -> tuple[float, float, float]:
    """Return the lowest and the highest command, and its maximum change per second."""
    rates = {"position": limit.velocity, "velocity": limit.acceleration, "effort": math.inf}
    return *limit.command_range(kind), rates[kind]


def _brakable(room: FloatArray, rate: FloatArray, period_s: float) -> FloatArray:
    """Return the speed v at which one period and braking need exactly ``room``: v * period_s + v² / (2 * rate)."""
    finite = np.where(np.isinf(room), 0.0, room)
    speed = 2.0 * finite / (period_s + np.sqrt(period_s**2 + 2.0 * finite / rate))  # also for a rate without bound
    return np.where(np.isinf(room), np.inf, speed)
