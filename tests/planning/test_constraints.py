"""Path constraints hold at every point of a motion, and a start or a goal that violates one is refused."""

import numpy as np
import pytest

from planning.constraints import LinkRegion, PathConstraints
from planning.kinematics.goals import PoseGoal, PositionSphere
from planning.motion import JointGoal, MotionRequest, State
from planning.planning_errors import PlanningError
from planning.scene import Box, Pose, SceneObject
from tests.planning.robots import robot_arm

ROBOT = robot_arm()
ARM = ROBOT.group("arm")
LINK = "gripper_base_link"
READY = {**ROBOT.rest, **ARM.group.states["ready"]}
SIDE = {**READY, "joint1": 1.2}
SCENE = ROBOT.scene.without("cube")


def request(start: State, goal: State, constraints: PathConstraints, blocked: bool = False) -> MotionRequest:
    hand = ROBOT.link_poses([LINK], {**READY, "joint1": 0.6})[LINK]
    post = SceneObject("post", ((Box(0.03, 0.03, 0.3), Pose()),), ROBOT.origin @ Pose(hand.position_m))
    scene = SCENE.with_object(post) if blocked else SCENE
    goals = (JointGoal({joint: goal[joint] for joint in ARM.joints}),)
    return MotionRequest(start=start, goals=goals, scene=scene, remaining_s=lambda: 5.0, constraints=constraints)


def test_a_joint_keeps_its_range() -> None:
    constraints = PathConstraints({"joint2": (-0.6, -0.3)})
    path = ARM.plan(request(READY, SIDE, constraints, blocked=True)).path
    lift = path.positions[:, ARM.joints.index("joint2")]
    assert lift.min() >= -0.6 - 1e-9 and lift.max() <= -0.3 + 1e-9


def test_a_link_keeps_its_orientation_around_an_obstacle() -> None:
    chain = ARM.chain(None, READY)
    here = chain.pose(np.array([READY[joint] for joint in ARM.joints]))
    region = PoseGoal(here, PositionSphere(10.0), (0.45, 0.45, 4.0))
    plain = ARM.plan(request(READY, SIDE, PathConstraints(), blocked=True)).path
    assert not region.contains(chain.transforms(plain.positions)).all()
    constraints = PathConstraints(regions=(LinkRegion(region),))
    path = ARM.plan(request(READY, SIDE, constraints, blocked=True)).path
    assert region.contains(chain.transforms(path.positions)).all()


def test_a_start_or_goal_that_breaks_a_constraint_is_refused() -> None:
    with pytest.raises(PlanningError, match=r"joint1 is at 0.*, outside its path constraint 0.5") as one:
        ARM.plan(request(READY, SIDE, PathConstraints({"joint1": (0.5, 1.0)})))
    assert one.value.code == "START_STATE_VIOLATES_PATH_CONSTRAINTS"
    here = ARM.chain(None, READY).pose(np.array([READY[joint] for joint in ARM.joints]))
    near = PathConstraints(regions=(LinkRegion(PoseGoal(here, PositionSphere(0.05), (4.0, 4.0, 4.0))),))
    with pytest.raises(
        PlanningError, match=f"goal: {LINK} is outside its path constraint, 0.284 m from its center"
    ) as other:
        ARM.plan(request(READY, SIDE, near))
    assert other.value.code == "GOAL_VIOLATES_PATH_CONSTRAINTS"
    with pytest.raises(PlanningError, match=f"start: {LINK} is outside"):
        ARM.plan(request(SIDE, READY, near))
