"""Limit cycles of joints at rest: which are seen, and how far goals go along with them."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.compensation.limit_cycle import GIVE_WAY_RAD, LimitCycle
from hal.types import FloatArray

PERIOD_S = 0.05
DEAD_BAND = 0.003
SWUNG = [0.01] * 4
"""Half a swing that is slow enough for the loop."""
LOOSE, HELD = np.array([True]), np.array([False])


def after(errors: Sequence[float], loose: np.ndarray = LOOSE, transmission: float = 1.0) -> LimitCycle:
    """What has been found behind so many cycles with these errors."""
    made = LimitCycle(np.array([DEAD_BAND * transmission]), np.array([transmission]))
    for error in errors:
        made.update(np.array([error * transmission]), loose, PERIOD_S)
    return made


@pytest.mark.parametrize(
    "errors",
    [
        [0.0, 0.01, 0.01, 0.004, 0.001],
        [0.01, 0.002, -0.002, 0.002],
        [-0.01, math.nan, -0.01],
    ],
    ids=["comes from one side", "stays in the dead band", "missing in between"],
)
def test_a_joint_that_stays_on_its_side_is_left_alone(errors: Sequence[float]) -> None:
    made = after(errors)
    assert not made.swinging.any() and not made.offset.any()


def test_the_goal_of_a_joint_that_swings_goes_along() -> None:
    swing = [*SWUNG, -0.004]
    assert after(swing).offset == pytest.approx(0.004)
    assert after([*swing, 0.002]).offset == pytest.approx(-0.002)
    assert after([*swing, -0.02]).offset == pytest.approx(GIVE_WAY_RAD)
    assert after([*swing, math.nan]).offset == pytest.approx(0.004), "where the servo is missing its goal stays"


def test_behind_a_swing_that_is_too_fast_for_the_loop_the_goal_would_drive_it_so_it_stays() -> None:
    light = after([0.01, -0.01, 0.01, -0.01, 0.01])
    assert not light.swinging.any() and abs(float(light.offset[0])) < GIVE_WAY_RAD


def test_a_joint_that_gravity_holds_or_whose_command_moves_swings_by_itself_to_rest() -> None:
    assert not after([0.01, -0.01, 0.01, -0.01], HELD).offset.any()


def test_once_the_command_moves_on_the_goal_returns_to_it_slowly() -> None:
    made = after([*SWUNG, -0.01])
    offsets = [float(made.offset[0])]
    for _ in range(40):
        made.update(np.array([-0.01]), HELD, PERIOD_S)
        offsets.append(float(made.offset[0]))
    assert 0.0 < -np.diff(offsets).min() <= 0.1 * offsets[0] * 1.001
    assert offsets[-1] < 0.02 * offsets[0]
    assert not made.swinging.any()


def test_a_finger_goes_along_by_its_servos_angle() -> None:
    assert after([*SWUNG, -0.01], transmission=0.03).offset == pytest.approx(0.03 * GIVE_WAY_RAD)


errors = st.one_of(st.just(math.nan), st.floats(-0.1, 0.1))


@given(st.lists(st.tuples(errors, st.booleans()), max_size=40))
def test_whatever_comes_the_goal_gives_way_by_no_more_than_allowed(cycles: list[tuple[float, bool]]) -> None:
    made = LimitCycle(np.array([DEAD_BAND]), np.ones(1))
    for error, loose in cycles:
        made.update(np.array([error]), np.array([loose]), PERIOD_S)
        offset: FloatArray = made.offset
        assert np.isfinite(offset).all() and np.abs(offset).max() <= GIVE_WAY_RAD
