"""Tests of the planning server with a robot that has two arms, each with a group and a controller of its own."""

from collections.abc import Iterator

import pytest

pytest.importorskip("moveit_msgs")
pytest.importorskip("ompl")

from moveit_msgs.msg import MoveItErrorCodes
from moveit_msgs.srv import GetPlanningScene, GetPositionFK, GetPositionIK

from tests.ros.plan_client import PlanClient, joint_goal, planning_stack

pytestmark = pytest.mark.slow

SUCCESS = MoveItErrorCodes.SUCCESS
ARM = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
READY = dict(zip(ARM, (0.0, -0.603, 0.396, 1.498, 0.048), strict=True))


@pytest.fixture(scope="module")
def client(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlanClient]:
    with planning_stack(tmp_path_factory.mktemp("plan"), "--arm", "bimanual_so101") as client:
        yield client


def of(arm: str, **changed: float) -> dict[str, float]:
    return {f"{arm}_{joint}": position for joint, position in {**READY, **changed}.items()}


def positions(client: PlanClient) -> dict[str, float]:
    state = client.call(GetPlanningScene, "/get_planning_scene", GetPlanningScene.Request()).scene.robot_state
    return dict(zip(state.joint_state.name, state.joint_state.position, strict=True))


def test_each_group_moves_its_own_arm(client: PlanClient) -> None:
    before = positions(client)
    for arm, other in (("right", "left"), ("left", "right")):
        result = client.run(joint_goal(f"{arm}_arm", **of(arm, shoulder_pan=0.2)))
        assert result.error_code.val == SUCCESS, result.error_code.message
        after = positions(client)
        assert {joint: after[joint] for joint in of(arm)} == pytest.approx(of(arm, shoulder_pan=0.2), abs=5e-3)
        still = {joint: before[joint] for joint in of(other)}
        assert {joint: after[joint] for joint in still} == pytest.approx(still, abs=5e-3)
        before = after


def test_the_common_group_moves_both_arms(client: PlanClient) -> None:
    goal = {**of("left", shoulder_pan=-0.1), **of("right", shoulder_pan=0.1)}
    result = client.run(joint_goal("both", **goal))
    assert result.error_code.val == SUCCESS, result.error_code.message
    after = positions(client)
    assert {joint: after[joint] for joint in goal} == pytest.approx(goal, abs=5e-3)


@pytest.mark.parametrize("arm", ["left", "right"])
def test_inverse_kinematics_of_each_arm(arm: str, client: PlanClient) -> None:
    forward = GetPositionFK.Request(fk_link_names=[f"{arm}_gripper_link"])
    pose = client.call(GetPositionFK, "/compute_fk", forward).pose_stamped[0]
    inverse = GetPositionIK.Request()
    inverse.ik_request.group_name, inverse.ik_request.pose_stamped = f"{arm}_arm", pose
    assert client.call(GetPositionIK, "/compute_ik", inverse).error_code.val == SUCCESS
