"""Tests of the damping of limit cycles: which oscillations are detected, and how far the goal follows the joint."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.compensation.limit_cycle import GIVE_WAY_RAD, LimitCycle

PERIOD_S = 0.05
DEAD_BAND = 0.003
SWUNG = [0.01] * 4
"""Half a period of an oscillation that is slow enough to be damped."""
LOOSE, HELD = True, False


def after(errors: Sequence[float], loose: bool = LOOSE, transmission: float = 1.0) -> LimitCycle:
    """Return the damping after cycles with these errors."""
    made = LimitCycle(DEAD_BAND * transmission, transmission)
    for error in errors:
        made.update(error * transmission, loose, PERIOD_S)
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
    assert not made.swinging and not made.offset


def test_the_goal_of_an_oscillating_joint_follows_it() -> None:
    swing = [*SWUNG, -0.004]
    assert after(swing).offset == pytest.approx(0.004)
    assert after([*swing, 0.002]).offset == pytest.approx(-0.002)
    assert after([*swing, -0.02]).offset == pytest.approx(GIVE_WAY_RAD)
    assert after([*swing, math.nan]).offset == pytest.approx(0.004), "the goal of a missing servo stays"


def test_the_goal_does_not_follow_an_oscillation_that_is_too_fast() -> None:
    light = after([0.01, -0.01, 0.01, -0.01, 0.01])
    assert not light.swinging and abs(light.offset) < GIVE_WAY_RAD


def test_loaded_joints_and_moving_joints_are_not_damped() -> None:
    assert not after([0.01, -0.01, 0.01, -0.01], HELD).offset


def test_the_offset_decays_slowly_after_the_command_moves() -> None:
    made = after([*SWUNG, -0.01])
    offsets = [made.offset]
    for _ in range(40):
        made.update(-0.01, HELD, PERIOD_S)
        offsets.append(made.offset)
    assert 0.0 < -np.diff(offsets).min() <= 0.1 * offsets[0] * 1.001
    assert offsets[-1] < 0.02 * offsets[0]
    assert not made.swinging


def test_the_offset_of_a_finger_follows_its_transmission() -> None:
    assert after([*SWUNG, -0.01], transmission=0.03).offset == pytest.approx(0.03 * GIVE_WAY_RAD)


errors = st.one_of(st.just(math.nan), st.floats(-0.1, 0.1))


@given(st.lists(st.tuples(errors, st.booleans()), max_size=40))
def test_the_offset_never_exceeds_its_maximum(cycles: list[tuple[float, bool]]) -> None:
    made = LimitCycle(DEAD_BAND, 1.0)
    for error, loose in cycles:
        made.update(error, loose, PERIOD_S)
        assert math.isfinite(made.offset) and abs(made.offset) <= GIVE_WAY_RAD
