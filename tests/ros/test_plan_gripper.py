"""Tests of the planning server with both gripper controllers of ros2_control."""

from collections.abc import Iterator

import pytest

pytest.importorskip("moveit_msgs")
pytest.importorskip("ompl")

from moveit_msgs.msg import MoveItErrorCodes
from moveit_msgs.srv import GetPlanningScene

from tests.ros.plan_client import READY, PlanClient, joint_goal, planning_stack

pytestmark = pytest.mark.slow

CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 20
    joint_state_broadcaster: {{type: joint_state_broadcaster/JointStateBroadcaster}}
    arm: {{type: joint_trajectory_controller/JointTrajectoryController}}
    fingers: {{type: {kind}}}
arm:
  ros__parameters:
    joints: [joint1, joint2, joint3, joint4, joint5, joint6]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
fingers:
  ros__parameters: {{joint: hand_right_joint, goal_tolerance: 0.0005}}
"""


@pytest.fixture(
    scope="module",
    params=[
        "position_controllers/GripperActionController",
        "parallel_gripper_action_controller/GripperActionController",
    ],
)
def client(
    request: pytest.FixtureRequest, ros_domain: int, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[PlanClient]:
    folder = tmp_path_factory.mktemp("gripper")
    file = folder / "controllers.yaml"
    file.write_text(CONTROLLERS.format(kind=request.param))
    with planning_stack(folder, "--controllers", str(file)) as client:
        yield client


def test_the_hand_moves_to_its_named_states(client: PlanClient) -> None:
    for position in (0.05, 0.01):
        result = client.run(joint_goal("hand", hand_right_joint=position))
        assert result.error_code.val == MoveItErrorCodes.SUCCESS, result.error_code.message
        joints = client.call(GetPlanningScene, "/get_planning_scene", GetPlanningScene.Request()).scene.robot_state
        state = dict(zip(joints.joint_state.name, joints.joint_state.position, strict=True))
        assert state["hand_right_joint"] == pytest.approx(position, abs=1e-3)


def test_the_arm_moves_with_a_controller_of_another_name(client: PlanClient) -> None:
    assert client.run(joint_goal(**READY)).error_code.val == MoveItErrorCodes.SUCCESS
