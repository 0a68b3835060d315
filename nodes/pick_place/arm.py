"""Move the arm and the hand during a job through the controllers of the stack."""

from collections.abc import Sequence
from typing import Any

from control_msgs.action import FollowJointTrajectory
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectoryPoint

from nodes.pick_place.action_goals import SentGoals
from pick_place.job import JobOutcome
from pick_place.settings import ArmSettings


def hand_topic(settings: ArmSettings) -> str:
    """Return the command topic of the hand."""
    return f"{settings.hand_controller}/commands"


class RosArm:
    """Arm and hand over ROS, one motion at a time. All methods must be called from the executor thread."""

    def __init__(self, node: Node, settings: ArmSettings) -> None:
        self._settings = settings
        action = f"{settings.arm_controller}/follow_joint_trajectory"
        self._goals = SentGoals(node, settings, (FollowJointTrajectory, action), _reason)
        self._hand = node.create_publisher(Float64MultiArray, hand_topic(settings), 10)

    def wait_for_server(self, timeout_s: float) -> bool:
        """Block until the arm's action server appears, and return whether it appeared in time."""
        return self._goals.wait_for_server(timeout_s)

    def hand(self, position_m: float) -> None:
        """Send a finger position without waiting for the fingers to reach it."""
        self._hand.publish(Float64MultiArray(data=[position_m]))

    def stop(self) -> None:
        """Cancel the running motion, if any."""
        self._goals.stop()

    async def move(self, positions_rad: Sequence[float]) -> JobOutcome:
        """Send one goal and wait for its outcome, within the configured timeouts."""
        return await self._goals.send(self._goal(positions_rad))

    def _goal(self, positions_rad: Sequence[float]) -> Any:
        duration = Duration(seconds=self._settings.move_time_s).to_msg()
        point = JointTrajectoryPoint(positions=list(positions_rad), time_from_start=duration)
        goal = FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = list(self._settings.joints)
        goal.trajectory.points = [point]
        return goal


def _reason(result: Any) -> str:
    return str(result.error_string or f"error code {result.error_code} without a text")
