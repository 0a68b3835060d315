"""Confirmed joint positions: a measurement becomes a command only if two readings in a row agree on it."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from hal.errors import ActivationError
from hal.types import FloatArray, JointState

READINGS: Final = 5
"""Number of readings, after the first, among which two in a row must agree."""


def confirmed_positions(
    state: JointState, read: Callable[[], JointState], names: Sequence[str], index: Sequence[int], step: FloatArray
) -> FloatArray:
    """Measure joints until two readings in a row agree.

    Args:
        state: The first reading.
        read: Measures the joints again, in the same order.
        names: The joints, k of them.
        index: Their places in a reading, shape (k,).
        step: Largest difference at which two readings agree, shape (k,), rad or m; NaN if a joint needs no position.

    Returns:
        Positions of shape (k,), rad or m.

    Raises:
        ActivationError: A joint was not measured, or its readings never agreed.
    """
    measured = _measured_now(state, names, index)
    for _ in range(READINGS):
        before, measured = measured, _measured_now(read(), names, index)
        doubtful = ~(np.isnan(step) | (np.abs(measured - before) <= step))
        if not doubtful.any():
            return measured
    if missing := [names[i] for i in np.flatnonzero(doubtful & ~np.isfinite(measured)).tolist()]:
        raise ActivationError(f"not activated: {', '.join(missing)} has not been measured: try once more")
    i = int(np.argmax(doubtful))
    raise ActivationError(
        f"not activated: {names[i]} is measured at {before[i]:.4f} and then at {measured[i]:.4f}: hold the arm still, "
        "and check the cable"
    )


def _measured_now(state: JointState, names: Sequence[str], index: Sequence[int]) -> FloatArray:
    """Positions (k,); NaN if the state only has an older one."""
    old = [name in state.faults and state.faults[name].kind != "no_torque" for name in names]
    return np.where(old, np.nan, state.position[list(index)])
