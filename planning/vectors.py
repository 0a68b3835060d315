"""Convert vectors that a client sent."""

import math
from typing import Any

import numpy as np

from hal.types import FloatArray


def vector_of(values: Any) -> FloatArray | None:
    """Return the values of a sequence as an array (n,), or None if ``values`` is not a sequence of numbers.

    A whole number beyond the range of a float becomes infinite.
    """
    try:
        return np.array([_number(value) for value in values], dtype=float)
    except (TypeError, ValueError):
        return None


def _number(value: Any) -> float:
    if isinstance(value, str | bytes):
        raise TypeError
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
