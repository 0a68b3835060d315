"""Goals at the full speed of MoveIt's plans succeed on virtual servos, and the arm is at rest afterward."""

from collections.abc import Sequence

import mujoco
import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.trajectory.goal import GoalHandle, TrajectoryGoal
from hal.types import FloatArray, JointLimits
from servoloop.simulation.stack import SimulatedStack
from tests.controller.moveit_plans import trapezoid

LIMITS = [JointLimits(-3.6, 3.6, 3.6, 9.6, 120.0)] * 6
"""Shares of velocity and acceleration in config/moveit/joint_limits.yaml."""
LIFTED_FAST = (2.899, 0.985, 0.854, 0.683, -0.9, -2.02), (0.624, -1.746, 0.352, 0.058, 0.17, -2.31)
"""Lifting the stretched arm takes the full effort of joint2, which lags by more than 0.3 rad."""
START_RAD = 0.01
"""Value of MoveIt's allowed_start_tolerance."""
RANGE = np.array([3.0, 1.95, 1.95, 1.95, 1.95, 3.0])


def at(pose: Sequence[float]) -> SimulatedStack:
    """Return a stack with the arm in a given pose and with no obstacle except for the table."""
    stack = SimulatedStack(start=[*pose, 0.0])
    stack.world.clear_table()
    stack.up()
    stack.run(1.5)
    return stack


def driven(stack: SimulatedStack, end: Sequence[float]) -> tuple[GoalHandle, float]:
    """Send a goal from the measured position, and return the motion of the arm in the second after its result."""
    points = trapezoid(here(stack).tolist(), end, LIMITS)
    goal = TrajectoryGoal(stack.arm.joints, tuple(points))
    reason = stack.arm.check(goal)
    assert reason is None, reason
    handle = stack.arm.submit(goal)
    stack.run(10.0, lambda: handle.done)
    told_at, moved = here(stack), [0.0]
    stack.after_cycle = lambda: moved.append(float(np.abs(here(stack) - told_at).max()))
    stack.run(1.0)
    stack.after_cycle = lambda: None
    return handle, max(moved)


def here(stack: SimulatedStack) -> FloatArray:
    assert stack.arm.tracking is not None
    return stack.arm.tracking.feedback_position


def test_goal_at_full_servo_speed_succeeds() -> None:
    start, end = LIFTED_FAST
    stack = at(start)
    handle, moved = driven(stack, end)
    assert handle.status is GoalStatus.SUCCEEDED, handle.error_text
    assert moved < START_RAD
    assert here(stack) == pytest.approx(end, abs=0.02)


@pytest.mark.slow
def test_thirty_goals_succeed_and_the_arm_is_at_rest_after_each() -> None:
    random = np.random.default_rng(32)
    stack = at((0.0, 0.0, -0.5, -0.5, 0.0, 0.0))
    for number in range(30):
        handle, moved = driven(stack, a_free_pose(stack, random))
        assert handle.status is GoalStatus.SUCCEEDED, (number, handle.error_text)
        assert moved < START_RAD, number


def a_free_pose(stack: SimulatedStack, random: np.random.Generator) -> FloatArray:
    """Return a random pose that the arm can reach on a straight line without collisions."""
    world, start = stack.world, here(stack)
    data = mujoco.MjData(world.model)
    data.qpos[:] = world.data.qpos
    while True:
        end: FloatArray = random.uniform(-RANGE, RANGE)
        for share in np.linspace(0.0, 1.0, 25):
            for name, position in zip(stack.arm.joints, start + (end - start) * share, strict=True):
                data.joint(name).qpos = position
            mujoco.mj_fwdPosition(world.model, data)
            if data.ncon:
                break
        else:
            return end
