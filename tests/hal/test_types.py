"""Tests of the number of decimals in messages about a value and its limit."""

import numpy as np
import pytest

from controller.trajectory.tolerances import excess
from hal.types import JointLimits, apart, beyond_range, far_outside


@pytest.mark.parametrize(
    ("value", "limit", "shown"),
    [
        (0.3, 0.05, ("0.3000", "0.0500")),
        (0.00004, 0.00003, ("0.00004", "0.00003")),
        (0.05, 1e-7, ("0.0500", "0.0000001")),
        (-1.00000004, -1.0, ("-1.00000004", "-1.0000")),
        (0.1, 0.0, ("0.1000", "0.0000")),
        (2.0, 2.0, ("2.0000", "2.0000")),
    ],
)
def test_a_value_and_its_limit_look_different(value: float, limit: float, shown: tuple[str, str]) -> None:
    assert apart(value, limit) == shown


def test_a_value_outside_a_range_differs_from_the_nearer_end() -> None:
    assert beyond_range(1.00001, -1.0, 1.0) == ("1.00001", "-1.0000", "1.0000")
    assert beyond_range(-1.5, -1.0, 1.0) == ("-1.5000", "-1.0000", "1.0000")
    limits = JointLimits(0.0, 0.00004, 1.0, 1.0, 1.0)
    assert far_outside(0.00005, limits) == "is at 0.00005, outside its limits 0.0000 to 0.00004"


def test_a_small_tolerance_is_printed_with_its_digits() -> None:
    shown = excess(["joint3"], np.array([0.00004]), {"joint3": 0.00003})
    assert shown == "joint3 is off by 0.00004, allowed is 0.00003"
