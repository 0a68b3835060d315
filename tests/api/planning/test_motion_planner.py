"""A planned motion touches nothing when virtual servos execute it. Impossible requests are rejected with a one-sentence
error."""

import math

import numpy as np
import pytest

from planning.kinematics.chain import ToolPose
from planning.kinematics.goals import PoseGoal, PositionSphere
from planning.planning_errors import PlanningError
from planning.scene import Box, Pose, SceneObject, Sphere
from servoloop import Arm, ArmInputError, ArmTrajectory, MotionPlanner

START = {"shoulder_pan": -0.9, "shoulder_lift": 0.3, "elbow_flex": 0.2, "wrist_flex": 0.4, "wrist_roll": 0.0}
GOAL = {"shoulder_pan": 0.9}
WALL = SceneObject("wall", ((Box(0.30, 0.02, 0.24), Pose()),), Pose(position_m=np.array([0.30, 0.0, 0.12])))


@pytest.fixture(scope="module")
def planner() -> MotionPlanner:
    planner = MotionPlanner("so101")
    planner.scene = planner.scene.without("cube").without("stand").with_object(WALL)
    return planner


def test_the_wall_is_in_the_straight_way(planner: MotionPlanner) -> None:
    distances = [planner.clearance({**START, "shoulder_pan": at}).distance_m for at in np.linspace(-0.9, 0.9, 40)]
    assert distances[0] > 0.0 and distances[-1] > 0.0 and min(distances) <= 0.0


def test_a_planned_motion_is_carried_out_and_touches_nothing(planner: MotionPlanner) -> None:
    trajectory = planner.plan(START, GOAL, speed=0.5)
    seen = []
    with Arm.simulated("so101", seed=1) as arm:
        arm.move_to(START, duration=3.0)
        arm.on_state(lambda state: seen.append(dict(state.position)))
        arm.follow(trajectory)
        assert arm.state.position["shoulder_pan"] == pytest.approx(0.9, abs=0.03)
    assert len(seen) > 20
    assert min(planner.clearance(positions).distance_m for positions in seen) > 0.0


def test_the_same_request_gives_the_same_motion(planner: MotionPlanner) -> None:
    assert planner.plan(START, GOAL) == planner.plan(START, GOAL)


def test_the_tool_reaches_a_pose_around_the_wall(planner: MotionPlanner) -> None:
    position_m, quaternion = planner.pose({**START, **GOAL})
    goal = PoseGoal(ToolPose(position_m, quaternion), PositionSphere(0.005), (0.05, 0.05, 0.05))
    trajectory = planner.plan(START, goal)
    last = {joint: values[-1] for joint, values in trajectory.positions.items()}
    assert np.linalg.norm(planner.pose(last)[0] - position_m) <= 0.005


def ball(planner: MotionPlanner, positions: dict[str, float], above_m: float) -> SceneObject:
    """Return a ball above the tool of an arm with these positions."""
    x, y, z = planner.pose(positions)[0]
    place = planner.robot.origin @ Pose(np.array([x, y, z + above_m]))
    return SceneObject("ball", ((Sphere(0.01), Pose()),), place)


@pytest.mark.parametrize("clearance_m", [4e-4, 8e-4, 1.5e-3])
def test_a_plan_that_begins_and_ends_near_an_object_can_be_followed(planner: MotionPlanner, clearance_m: float) -> None:
    scene, low, high = planner.scene, 0.0, 0.1
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        planner.scene = scene.with_object(ball(planner, START, middle))
        low, high = (middle, high) if planner.clearance(START).distance_m < clearance_m else (low, middle)
    planner.scene = scene.with_object(ball(planner, START, high))
    away = planner.plan(START, {"shoulder_pan": -1.4})
    back = planner.plan({**START, "shoulder_pan": -1.4}, START)
    assert planner.contact(away, START) == planner.contact(back, START) == ""
    planner.scene = scene.with_object(ball(planner, {**START, "shoulder_pan": -1.1}, 0.0))
    assert "ball after" in planner.contact(away, START)
    planner.scene = scene


def test_a_trajectory_of_some_joints_is_checked_with_the_other_joints_at_their_start(planner: MotionPlanner) -> None:
    times_s = [0.0, 1.0, 2.0]
    assert planner.contact(ArmTrajectory(times_s, {"shoulder_pan": [-0.9, -1.0, -1.1]}), START) == ""
    assert "wall" in planner.contact(ArmTrajectory(times_s, {"shoulder_pan": [-0.9, 0.0, 0.9]}), START)


def test_impossible_requests_are_refused(planner: MotionPlanner) -> None:
    with pytest.raises(PlanningError, match="wall") as refused:
        planner.plan(START, {"shoulder_pan": 0.0})
    assert refused.value.code == "GOAL_IN_COLLISION"
    with pytest.raises(PlanningError, match="shoulder_pan"):
        planner.plan(START, {"shoulder_pan": 5.0})
    with pytest.raises(ArmInputError, match="no planning group moves joint elbow of the goal: use only the joints"):
        planner.plan(START, {"elbow": 0.1})
    with pytest.raises(ArmInputError, match="shoulder_lift has no position in the start"):
        planner.plan({"shoulder_pan": 0.0}, GOAL)
    with pytest.raises(ArmInputError, match="the start has a position for knee, which is not a joint: choose from"):
        planner.plan({**START, "knee": 0.0}, GOAL)
    with pytest.raises(ArmInputError, match="the start has a position for 3, which is not a joint: choose from"):
        planner.plan({**START, 3: 0.0, "knee": 0.0}, GOAL)
    with pytest.raises(ArmInputError, match="no planning group moves joint 3 of the goal: use only the joints"):
        planner.plan(START, {3: 0.0, "elbow": 0.1})
    with pytest.raises(ArmInputError, match="the start must be positions keyed by joint name, not None"):
        planner.plan(None, GOAL)
    with pytest.raises(ArmInputError, match=r"the goal must be positions keyed by joint name, not \[0.1\]"):
        planner.plan(START, [0.1])
    with pytest.raises(ArmInputError, match="shoulder_pan must be a number, not '1'"):
        planner.plan(START, {"shoulder_pan": "1"})  # type: ignore[dict-item]
    with pytest.raises(ArmInputError, match="shoulder_pan is nan"):
        planner.plan({**START, "shoulder_pan": math.nan}, GOAL)
    far = PoseGoal(
        ToolPose(np.array([2.0, 0.0, 0.2]), np.array([0.0, 0.0, 0.0, 1.0])), PositionSphere(0.005), (4.0, 4.0, 4.0)
    )
    with pytest.raises(PlanningError, match="cannot reach the goal: the nearest pose is") as refused:
        planner.plan(START, far)
    assert refused.value.code == "NO_IK_SOLUTION"
