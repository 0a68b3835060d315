"""Confirm measured joint positions before they become commands: two consecutive readings must agree."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from hal.hal_errors import ActivationError
from hal.types import FloatArray, JointState

READINGS: Final = 5
"""Maximum number of readings after the first. Two consecutive readings must agree."""


def confirmed_positions(
    state: JointState, read: Callable[[], JointState], names: Sequence[str], index: Sequence[int], step: FloatArray
) -> FloatArray:
    """Measure joints until two consecutive readings agree.

    Args:
        state: The first reading.
        read: Function that measures the joints again, in the same order.
        names: Names of the k joints.
        index: Indices of the joints in a reading, shape (k,).
        step: Maximum difference between two readings that agree, shape (k,), in rad or m. Use NaN for a joint
            whose position is not needed.

    Returns:
        Positions of shape (k,), in rad or m.

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
        raise ActivationError(f"not activated: could not measure {', '.join(missing)}. Try again")
    i = int(np.argmax(doubtful))
    raise ActivationError(
        f"not activated: two readings of {names[i]} differ ({before[i]:.4f}, then {measured[i]:.4f}). Hold the arm "
        "still and check the cable"
    )


def _measured_now(state: JointState, names: Sequence[str], index: Sequence[int]) -> FloatArray:
    """Return positions of shape (k,). A position that was not measured in this reading is NaN."""
    old = [name in state.faults and state.faults[name].kind != "no_torque" for name in names]
    return np.where(old, np.nan, state.position[list(index)])
