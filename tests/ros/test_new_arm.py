"""An arm created by ``servoloop arms new`` is emulated, moved and shown on the page."""

import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from servoloop.stack.arm_folders import find_arm
from tests.arms.test_new import BLOCK
from tests.pages import commands
from tests.ros.manager_client import ManagerClient, manager_client
from tests.ros.stack_process import emulating, running
from tests.view.view_process import viewing

pytestmark = pytest.mark.slow

LIFT = "shoulder_lift"
GOAL_RAD, OFF_RAD = -0.3, 0.06


@pytest.fixture
def arm(tmp_path: Path) -> str:
    """Create the folder of the new arm."""
    (tmp_path / "robot.urdf").write_text(BLOCK.sub("", find_arm("so101").urdf.read_text()))
    command = [sys.executable, "-m", "servoloop", "arms", "new", str(tmp_path / "mine"), str(tmp_path / "robot.urdf")]
    subprocess.run(command, check=True, capture_output=True, timeout=60.0)
    return str(tmp_path / "mine")


def move(client: ManagerClient, joints: list[str]) -> None:
    """Move all joints to zero and one of them to a goal, and return after success."""
    action = ActionClient(client.node, FollowJointTrajectory, "/arm_controller/follow_joint_trajectory")
    assert action.wait_for_server(20.0)
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = joints
    point = JointTrajectoryPoint(positions=[GOAL_RAD if name == LIFT else 0.0 for name in joints])
    point.time_from_start.sec = 2
    goal.trajectory.points = [point]
    sent = action.send_goal_async(goal)
    client.spin_until(sent.done)
    result = sent.result().get_result_async()
    client.spin_until(result.done)
    assert result.result().result.error_code == FollowJointTrajectory.Result.SUCCESSFUL, result.result().result
    action.destroy()


@pytest.mark.runs(*commands("arms/README.md"))
def test_new_arm_is_emulated_moved_and_shown(ros_domain: int, tmp_path: Path, arm: str) -> None:
    joints = ["shoulder_pan", LIFT, "elbow_flex", "wrist_flex", "wrist_roll"]
    with (
        emulating(tmp_path, "--arm", arm) as link,
        running(tmp_path, "--arm", arm, "--port", str(link)),
        manager_client() as client,
    ):
        assert set(client.states().values()) == {"active"}
        with client.hearing(JointState, "/joint_states") as heard:
            move(client, joints)
            client.spin_until(lambda: bool(heard))
            at = dict(zip(heard[-1].name, heard[-1].position, strict=True))
        assert abs(at[LIFT] - GOAL_RAD) < OFF_RAD
        with viewing("--arm", "mine") as address, urllib.request.urlopen(address, timeout=20.0) as page:
            assert page.status == 200
