"""The jogging client considers a goal running only while the stack that reported it exists."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar

import pytest

pytest.importorskip("rclpy")

from action_msgs.msg import GoalStatus, GoalStatusArray
from controller_manager_msgs.msg import ControllerState
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_action_status_default

from hal.types import JointLimits
from nodes.client_node import client_node
from nodes.handling.robot import HandlingError, JointsNow
from nodes.handling.robot_client import TRAJECTORY, RobotClient
from tests.ros.stack_process import until

pytestmark = pytest.mark.ros

STATUS = "/arm/follow_joint_trajectory/_action/status"
EXECUTING, ABORTED = (
    [GoalStatus(status=status)] for status in (GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_ABORTED)
)


class RobotAtRest:
    """A robot with one joint at position zero."""

    limits: ClassVar = {"joint1": JointLimits(-2.0, 2.0, 4.0, 12.0, 120.0)}

    def joints_now(self) -> JointsNow:
        return JointsNow({"joint1": 0.0}, {"joint1": 0.0}, 0.0, {})


@contextmanager
def stack(node: Node) -> Iterator[Publisher]:
    """Goal status publisher of a stack that can end without a last message, like a killed process."""
    publisher = node.create_publisher(GoalStatusArray, STATUS, qos_profile_action_status_default)
    try:
        yield publisher
    finally:
        node.destroy_publisher(publisher)


def test_goal_of_a_killed_stack_does_not_block_motions(ros_domain: int) -> None:
    with client_node("test_robot_client") as (node, executor):
        client = RobotClient(node, executor, RobotAtRest())
        controller = client._create(
            ControllerState(name="arm", type=TRAJECTORY, required_command_interfaces=["joint1/position"])
        )
        assert controller is not None
        client._controllers["arm"] = controller

        def report(publisher: Publisher, statuses: list[GoalStatus], busy: bool) -> None:
            def arrived() -> bool:
                publisher.publish(GoalStatusArray(status_list=statuses))
                executor.spin_once(timeout_sec=0.05)
                return controller.busy is busy

            until(arrived)

        with stack(node) as killed:
            report(killed, EXECUTING, busy=True)
            with pytest.raises(HandlingError, match="arm has a goal under way: stop it first"):
                client.jog("joint1", 0.1)
            with stack(node) as newer:
                until(lambda: node.count_publishers(STATUS) == 2)
                client.jog("joint1", 0.1)  # A killed process remains in the graph for seconds.
                report(newer, EXECUTING, busy=True)
                with pytest.raises(HandlingError, match="arm has a goal under way"):
                    client.jog("joint1", 0.1)
                report(newer, ABORTED, busy=False)
                client.jog("joint1", 0.1)
                report(newer, EXECUTING, busy=True)
        until(lambda: node.count_publishers(STATUS) == 0)
        client.jog("joint1", 0.1)
