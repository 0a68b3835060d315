"""Streamed goals are approached within the velocity and acceleration limits, however far and often they jump."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.forward.forward_command_controller import ForwardCommandController
from hal.types import FloatArray, JointLimits, JointState
from tests.controller.bench import ARM_LIMITS, PERIOD_S

JOINT = "joint1"
GOALS = st.lists(st.tuples(st.floats(-2.0, 2.0), st.integers(1, 40)), min_size=1, max_size=8)
"""Goals in rad, each with the number of cycles for which it is sent."""


def commands(limits: JointLimits, goals: list[tuple[float, int]], period_s: float = PERIOD_S) -> FloatArray:
    """Return the commands of a joint that is at rest at 0 until the first goal."""
    controller = ForwardCommandController("stream", (JOINT,), (limits,), (JOINT,))
    state = JointState(0.0, np.zeros(1), np.zeros(1), np.zeros(1))
    controller.activate(state, np.zeros(1))
    found = [0.0, 0.0]
    for goal, cycles in goals:
        controller.submit([goal])
        for _ in range(cycles):
            controller.update(state, 0.0, period_s)
            found.append(float(controller.command[0]))
    return np.array(found)


def test_a_far_first_goal_is_approached_without_a_jump_of_the_velocity() -> None:
    path = commands(ARM_LIMITS, [(1.5, 40)])
    assert np.diff(path, 2).max() / PERIOD_S**2 == pytest.approx(ARM_LIMITS.acceleration)
    assert np.diff(path, 2).min() / PERIOD_S**2 >= -1.001 * ARM_LIMITS.acceleration
    assert path.max() == path[-1] == 1.5


@given(GOALS, st.floats(0.1, 10.0), st.floats(0.5, 100.0), st.sampled_from([0.005, 0.02, 0.05, 0.1]))
def test_commands_keep_all_limits_whatever_the_goals(
    goals: list[tuple[float, int]], velocity: float, acceleration: float, period_s: float
) -> None:
    path = commands(JointLimits(-2.0, 2.0, velocity, acceleration, 1e3), goals, period_s)
    assert np.abs(np.diff(path)).max() <= velocity * period_s * 1.0001 + 1e-8
    assert np.abs(np.diff(path, 2)).max() <= acceleration * period_s**2 * 1.0001 + 1e-8
    assert path.min() >= -2.0 and path.max() <= 2.0


@given(st.floats(-2.0, 2.0), st.floats(0.1, 10.0), st.floats(0.5, 100.0))
def test_a_joint_arrives_in_the_shortest_time_and_never_passes_its_goal(
    goal: float, velocity: float, acceleration: float
) -> None:
    limits = JointLimits(-2.0, 2.0, velocity, acceleration, 1e3)
    fastest_s = 2.0 * np.sqrt(abs(goal) / acceleration) + abs(goal) / velocity + velocity / acceleration
    path = commands(limits, [(goal, int(fastest_s / PERIOD_S) + 4)])
    assert path[-1] == goal and np.abs(path).max() == abs(goal)


@given(st.floats(-0.03, 0.03))
def test_a_goal_that_a_resting_joint_can_reach_in_one_cycle_is_commanded_at_once(goal: float) -> None:
    assert commands(ARM_LIMITS, [(goal, 1)])[-1] == pytest.approx(goal, abs=1e-12)


def test_a_steady_stream_is_followed_at_its_speed_at_the_braking_distance() -> None:
    speed = 1.0
    path = commands(ARM_LIMITS, [(speed * PERIOD_S * n, 1) for n in range(1, 40)])
    assert np.diff(path)[-10:] == pytest.approx(speed * PERIOD_S)
    behind = speed * PERIOD_S * 39 - path[-1]
    assert behind <= speed**2 / (2.0 * ARM_LIMITS.acceleration)
