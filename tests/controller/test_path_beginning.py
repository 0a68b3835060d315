"""Test the first points of a plan that begins slightly off the commanded position."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.trajectory.paths import BEGINNING_S, NEAR, begun_at
from controller.trajectory.waypoints import Waypoints

STEP_S = 0.002


def points(duration_s: float, first_s: float = 0.0) -> Waypoints:
    """Return points of one joint at constant speed from 0 to 1, with velocities and accelerations."""
    times_s = np.append(np.arange(first_s, duration_s, STEP_S), duration_s)
    position = (times_s / duration_s)[:, None]
    known = np.ones(len(times_s), dtype=np.bool_)
    return Waypoints(times_s, position, np.full_like(position, 1.0 / duration_s), 0.0 * position, known, known)


@given(offset=st.floats(-NEAR, NEAR), duration_s=st.floats(0.05, 3.0))
def test_a_path_starts_here_and_soon_follows_the_plan(offset: float, duration_s: float) -> None:
    plan = points(duration_s)
    found = begun_at(plan, np.array([offset]))
    assert found.position[0, 0] == pytest.approx(offset)
    later = plan.times_s >= min(BEGINNING_S, duration_s)
    assert found.position[later] == pytest.approx(plan.position[later], abs=1e-12)
    assert found.velocity[later] == pytest.approx(plan.velocity[later], abs=1e-9)
    assert np.abs(found.position - plan.position).max() <= abs(offset) + 1e-12


def test_velocities_and_accelerations_match_the_positions() -> None:
    found = begun_at(points(1.0), np.array([0.04]))
    velocity = np.gradient(found.position[:, 0], STEP_S)
    assert found.velocity[2:-2, 0] == pytest.approx(velocity[2:-2], abs=2e-4)
    acceleration = np.gradient(found.velocity[:, 0], STEP_S)
    assert found.acceleration[2:-2, 0] == pytest.approx(acceleration[2:-2], abs=0.1)


def test_a_plan_that_starts_far_away_is_not_changed() -> None:
    plan = points(1.0)
    assert (begun_at(plan, np.array([1.1 * NEAR])).position == plan.position).all()


def test_a_plan_that_starts_later_is_not_changed() -> None:
    plan = points(1.0, first_s=0.1)
    assert begun_at(plan, np.array([0.1])) is plan


def test_a_plan_that_has_started_is_joined_at_its_current_point() -> None:
    plan = points(1.0)
    late = Waypoints(plan.times_s - 0.5, *(getattr(plan, name) for name in Waypoints.__slots__[1:]))
    found = begun_at(late, np.array([0.51]))
    assert np.interp(0.0, late.times_s, found.position[:, 0]) == pytest.approx(0.51, abs=1e-3)
