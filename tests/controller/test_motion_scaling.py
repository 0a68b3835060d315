"""Test that speed scaling stays within the acceleration limits and rejects invalid factors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.motion import Kinematics
from controller.trajectory.speed_scaling import SpeedScaling, scaled
from tests.controller.waypoints import LIMITS

CRUISING = Kinematics(np.zeros(2), np.array([2.0, -1.0]), np.zeros(2))


@pytest.mark.parametrize("factor", [-1.0, float("nan"), float("inf")])
def test_an_invalid_factor_is_ignored_with_a_reason(factor: float) -> None:
    scaling = SpeedScaling(LIMITS)
    assert "ignored" in (scaling.ask(factor) or "")
    assert scaling.asked == 1.0


def test_a_factor_above_one_is_limited_with_a_reason() -> None:
    scaling = SpeedScaling(LIMITS, initial=0.5)
    assert "counts as 1" in (scaling.ask(2.0) or "")
    assert scaling.asked == 1.0


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.0])
def test_a_valid_factor_is_applied(factor: float) -> None:
    scaling = SpeedScaling(LIMITS)
    assert scaling.ask(factor) is None
    assert scaling.asked == factor


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-2.0, 2.0), st.floats(-8.0, 8.0), st.floats(0.001, 0.1))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_a_change_of_speed_keeps_the_acceleration_limit(
    before: float, asked: float, velocity: float, acceleration: float, step_s: float
) -> None:
    scaling = SpeedScaling(LIMITS, initial=before)
    scaling.ask(asked)
    scaling.advance(Kinematics(np.zeros(2), np.full(2, velocity), np.full(2, acceleration)), step_s)
    rate = (scaling.factor - before) / step_s
    assert min(before, asked) - 1e-12 <= scaling.factor <= max(before, asked) + 1e-12
    assert abs(rate * velocity) <= LIMITS[1].acceleration + abs(acceleration) + 1e-9


def test_a_pause_and_a_resume_complete() -> None:
    scaling = SpeedScaling(LIMITS)
    for asked in (0.0, 1.0):
        scaling.ask(asked)
        for _ in range(40):
            scaling.advance(CRUISING, 0.05)
        assert scaling.factor == asked


def test_a_path_that_starts_in_motion_starts_at_full_rate() -> None:
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
