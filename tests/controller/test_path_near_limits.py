"""Test that plans close to a position limit are executed and no command leaves the limits."""

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.motion import Kinematics
from controller.trajectory.goal import Allowed, GoalPoint, TrajectoryGoal
from controller.trajectory.goal_planner import GoalPlanner
from tests.controller.bench import ARM, ARM_LIMITS, Bench, arm_parameters, through
from tests.controller.moveit_plans import trapezoid

STEP_S = 0.1
"""Time between two points of a MoveIt plan, in seconds."""


def turn(lowest: float, accelerations: bool) -> list[GoalPoint]:
    """Return points of a smooth motion down to ``lowest`` and back up, with the turning point between two points of the
    plan."""
    points = []
    for number in range(1, 17):
        at_s = (number - 8.5) * STEP_S
        position, velocity, acceleration = lowest + 0.5 * at_s**2, at_s, 1.0
        if number == 16:
            velocity = acceleration = 0.0
        points.append(
            GoalPoint(
                (position, 0.0),
                1.0 + number * STEP_S,
                (velocity, 0.0),
                (acceleration, 0.0) if accelerations else (),
            )
        )
    return points


@pytest.mark.parametrize("accelerations", [True, False])
@pytest.mark.parametrize("method", ["ruckig", "splines"])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_path_slightly_beyond_a_limit_is_executed_within_the_limit(
    method: str, accelerations: bool, side: float
) -> None:
    bench = Bench(arm_parameters(interpolation_method=method)).up()
    beyond = [
        GoalPoint(
            (-side * point.positions[0], 0.0),
            point.time_from_start_s,
            (-side * point.velocities[0], 0.0),
            tuple(-side * one for one in point.accelerations),
        )
        for point in turn(ARM_LIMITS.lower - 0.0002, accelerations)
    ]
    handle = bench.send(through(*beyond))
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert 1.99 < (side * bench.path()[:, 0]).max() <= 2.0
    assert (side * bench.path()[-1][0]) == pytest.approx(side * beyond[-1].positions[0])


@pytest.mark.parametrize("method", ["ruckig", "splines"])
def test_a_path_far_beyond_a_limit_is_rejected(method: str) -> None:
    bench = Bench(arm_parameters(interpolation_method=method)).up()
    near = GoalPoint((-1.99, 0.0), 1.0, (-1.0, 0.0)), GoalPoint((-1.99, 0.0), 1.1, (1.0, 0.0))
    reason = bench.arm.check(through(*near, GoalPoint((0.0, 0.0), 3.0, (0.0, 0.0))))
    assert reason is not None and reason.startswith("shoulder would swing to -2.0")


def test_lines_that_start_near_a_limit_are_planned_within_the_limits() -> None:
    """The plan begins at the measured position, which is slightly off the command."""
    limits, random = (ARM_LIMITS, ARM_LIMITS), np.random.default_rng(20)
    planner = GoalPlanner(ARM, limits, "ruckig")
    for _ in range(40):
        begins = np.array((-2.0 + random.uniform(-0.001, 0.06), 0.3))
        command = np.clip(np.add(begins, (random.uniform(-0.03, 0.03), 0.0)), -2.0, 2.0)
        end = (random.uniform(-1.99, -1.2), random.uniform(-1.0, 1.0))
        goal = TrajectoryGoal(ARM, tuple(trapezoid(begins.tolist(), end, limits)))
        reference = Kinematics.at_rest(command)
        path = planner.plan(goal, Allowed(), reference, begins).join(reference, 0.0)
        lowest = min(path.sample(at_s).position[0] for at_s in np.arange(0.0, path.duration_s, 0.02))
        assert lowest >= ARM_LIMITS.lower - 0.004
