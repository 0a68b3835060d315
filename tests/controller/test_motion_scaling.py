"""Speed scaling: reached within the acceleration limits, and refused where it makes no sense."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.motion import Kinematics
from controller.trajectory.speed_scaling import SpeedScaling, scaled
from tests.controller.waypoints import LIMITS

CRUISING = Kinematics(np.zeros(2), np.array([2.0, -1.0]), np.zeros(2))


@pytest.mark.parametrize("factor", [-1.0, float("nan"), float("inf")])
def test_nonsense_is_ignored_and_said(factor: float) -> None:
    scaling = SpeedScaling(LIMITS)
    assert "ignored" in (scaling.ask(factor) or "")
    assert scaling.asked == 1.0


def test_faster_than_the_goal_is_not_done_and_said() -> None:
    scaling = SpeedScaling(LIMITS, initial=0.5)
    assert "counts as 1" in (scaling.ask(2.0) or "")
    assert scaling.asked == 1.0


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.0])
def test_what_makes_sense_is_taken(factor: float) -> None:
    scaling = SpeedScaling(LIMITS)
    assert scaling.ask(factor) is None
    assert scaling.asked == factor


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-2.0, 2.0), st.floats(-8.0, 8.0), st.floats(0.001, 0.1))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_a_change_never_takes_more_acceleration_than_there_is(
    before: float, asked: float, velocity: float, acceleration: float, step_s: float
) -> None:
    scaling = SpeedScaling(LIMITS, initial=before)
    scaling.ask(asked)
    scaling.advance(Kinematics(np.zeros(2), np.full(2, velocity), np.full(2, acceleration)), step_s)
    rate = (scaling.factor - before) / step_s
    assert min(before, asked) - 1e-12 <= scaling.factor <= max(before, asked) + 1e-12
    assert abs(rate * velocity) <= LIMITS[1].acceleration + abs(acceleration) + 1e-9


def test_a_pause_comes_to_its_end_and_so_does_a_resume() -> None:
    scaling = SpeedScaling(LIMITS)
    for asked in (0.0, 1.0):
        scaling.ask(asked)
        for _ in range(40):
            scaling.advance(CRUISING, 0.05)
        assert scaling.factor == asked


def test_what_begins_in_movement_begins_at_full_rate() -> None:
    scaling = SpeedScaling(LIMITS, initial=0.25)
    scaling.restart(moving=True)
    assert scaling.factor == 1.0
    scaling.restart(moving=False)
    assert scaling.factor == 0.25


def test_velocity_and_acceleration_are_scaled() -> None:
    state = scaled(Kinematics(np.ones(2), np.array([2.0, 0.0]), np.array([4.0, 0.0])), 0.5)
    assert state.position == pytest.approx((1.0, 1.0))
    assert state.velocity == pytest.approx((1.0, 0.0))
    assert state.acceleration == pytest.approx((1.0, 0.0))
