"""The safety gate checks and limits every command before it reaches the hardware.

The gate does not trust the controllers. The gate's output depends only on its arguments and satisfies these rules:

- All values are finite and within the joint limits.
- A position differs from the last command by no more than the distance that the joint may travel in one period. A joint
  that starts outside its limits returns at a tenth of that speed.
- A velocity changes no faster than the acceleration limit allows.
- A velocity toward the end of a joint's range is low enough for the joint to brake before it reaches that end.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hal.types import FloatArray, JointLimits, apart, beyond_range

RETURN_SHARE: Final = 0.1
"""Fraction of the velocity limit at which a joint outside its limits returns to them."""


def clipped(values: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Clamp values (n,) to limits (n,) like ``np.clip``, but in a third of the time.

    Args:
        values: Values of shape (n,).
        lower: Lower limits of shape (n,).
        upper: Upper limits of shape (n,).
    """
    inside: FloatArray = np.minimum(np.maximum(values, lower), upper)
    return inside


@dataclass(frozen=True, slots=True)
class Gated:
    """Output of the safety gate."""

    values: FloatArray
    """Safe commands of shape (m,)."""
    reasons: dict[int, str]
    """Reason for each command that was changed, keyed by index."""


class SafetyGate:
    """Limiter for the commands of m command interfaces (in rad, m, N m, N, and per second).

    Args:
        limits: Limits of each interface's joint.
        kinds: Type of each interface: "position" (the default), "velocity" or "effort".
    """

    def __init__(self, limits: Sequence[JointLimits], kinds: Sequence[str] | None = None) -> None:
        """Create the gate.

        Args:
            limits: Limits of each command interface's joint, length m.
            kinds: Type of each interface, length m: ``position``, ``velocity`` or ``effort``. By default, all
                interfaces are position interfaces.
        """
        kinds = kinds or ["position"] * len(limits)
        bounds = [_bounds(kind, limit) for kind, limit in zip(kinds, limits, strict=True)]
        self._lower, self._upper, self._rate = (np.array([bound[i] for bound in bounds]) for i in range(3))
        self._held = np.array([kind == "position" for kind in kinds], dtype=bool)
        self._speeds = [i for i, kind in enumerate(kinds) if kind == "velocity"]
        self._each = [] if self._speeds else bounds
        """Lower limit, upper limit and rate of each interface. The list is empty if there are velocity interfaces."""
        self._ends = np.array([(limits[i].lower, limits[i].upper) for i in self._speeds]).reshape(-1, 2)

    def limit(self, wanted: FloatArray, last: FloatArray, period_s: float, measured: FloatArray | None = None) -> Gated:
        """Limit a command.

        Args:
            wanted: Command of shape (m,).
            last: Previous output of the gate, of shape (m,).
            period_s: Duration of the period, in seconds.
            measured: Measured position of each interface's joint, of shape (m,); NaN if it is unknown. Needed only
                for velocity commands.

        Returns:
            The safe values, and the reason for each change.
        """
        if self._within(wanted, last, period_s):
            return Gated(wanted.copy(), {})
        finite = np.where(np.isfinite(wanted), wanted, np.where(self._held, last, 0.0))
        inside = np.clip(finite, self._lower, self._upper)
        if self._speeds and measured is not None:
            inside[self._speeds] = self._braked(inside, period_s, measured[self._speeds])
        reach = self._rate * period_s
        outside = self._held & ((last < self._lower) | (last > self._upper))
        if outside.any():
            reach = np.where(outside, RETURN_SHARE * reach, reach)
        safe = np.clip(inside, last - reach, last + reach)
        # The tolerance of 1e-9 is needed because rounding may move a command slightly away from a limit that it should
        # equal. The comparison is also true for NaN.
        if not np.abs(safe - wanted).max(initial=0.0) <= 1e-9:
            returning = {
                i: f"position {self._outside(i, last[i])}: returning slowly" for i in np.flatnonzero(outside).tolist()
            }
            return Gated(safe, self._reasons(wanted, inside, safe) | returning)
        return Gated(safe, {})

    def _within(self, wanted: FloatArray, last: FloatArray, period_s: float) -> bool:
        """Return whether no rule changes a command, which is the usual case. Plain floats are faster here than
        arrays."""
        for value, former, (lower, upper, rate) in zip(wanted.tolist(), last.tolist(), self._each, strict=False):
            reach = rate * period_s
            inside = lower <= value <= upper and lower <= former <= upper
            if not (inside and former - reach <= value <= former + reach):
                return False
        return bool(self._each)

    def _braked(self, wanted: FloatArray, period_s: float, measured: FloatArray) -> FloatArray:
        """Reduce velocities so that each joint can still brake within its range one period later."""
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
                texts = apart(value, safe[i])
                reasons[i] = "command {} is too fast this close to the end of the range: limited to {}".format(*texts)
            elif abs(inside[i] - value) > 1e-9:
                reasons[i] = f"command {self._outside(i, value)}"
            elif not abs(safe[i] - value) <= 1e-9:
                reasons[i] = "command {} is too far for one cycle: limited to {}".format(*apart(value, safe[i]))
        return reasons

    def _outside(self, i: int, value: float) -> str:
        return "{} is outside the limits {} to {}".format(*beyond_range(value, self._lower[i], self._upper[i]))


def _bounds(kind: str, limit: JointLimits) -> tuple[float, float, float]:
    """Return the lowest command, the highest command and the maximum change per second."""
    rates = {"position": limit.velocity, "velocity": limit.acceleration, "effort": math.inf}
    return *limit.command_range(kind), rates[kind]


def _brakable(room: FloatArray, rate: FloatArray, period_s: float) -> FloatArray:
    """Return the speed v that uses exactly ``room``: v * period_s (one period) + v² / (2 * rate) (braking)."""
    finite = np.where(np.isinf(room), 0.0, room)
    speed = 2.0 * finite / (period_s + np.sqrt(period_s**2 + 2.0 * finite / rate))  # this form allows an infinite rate
    return np.where(np.isinf(room), np.inf, speed)
