"""States of virtual servos in the servo state broadcaster, from the bus to the topic."""

from pathlib import Path

import pytest
import rclpy
from control_msgs.msg import DynamicJointState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from tests.ros.stack_process import running, until

CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 20
    servo_states: {type: servoloop/ServoStateBroadcaster}
servo_states:
  ros__parameters: {rate: 0.0}
"""


@pytest.mark.slow
def test_each_servo_reports_its_state(ros_domain: int, tmp_path: Path) -> None:
    controllers = tmp_path / "controllers.yaml"
    controllers.write_text(CONTROLLERS)
    seen: list[dict[str, dict[str, float]]] = []

    def keep(message: DynamicJointState) -> None:
        values = [dict(zip(v.interface_names, v.values, strict=True)) for v in message.interface_values]
        seen.append(dict(zip(message.joint_names, values, strict=True)))

    with running(tmp_path, "--controllers", str(controllers)):
        rclpy.init()
        node, executor = Node("client"), SingleThreadedExecutor()
        executor.add_node(node)
        node.create_subscription(DynamicJointState, "/servo_states/dynamic_joint_states", keep, 10)
        until(lambda: executor.spin_once(timeout_sec=0.1) or len(seen) >= 3)
        node.destroy_node()
        rclpy.try_shutdown()
    assert set(seen[0]) == {*(f"joint{i}" for i in range(1, 7)), "hand_right_joint"}
    for joint, values in seen[-1].items():
        assert 4.0 < values["voltage"] < 15.0
        assert 0.0 < values["temperature"] < 80.0
        assert -1.0 <= values["load"] <= 1.0
        assert (values["alarms"], values["fault"]) == (0.0, 0.0)
        assert values["replies"] > seen[0][joint]["replies"]


def _publishers(node: Node) -> set[tuple[str, str]]:
    """Return pairs of node name and topic of all publishers."""
    return {
        (publisher.node_name, topic)
        for topic, _ in node.get_topic_names_and_types()
        for publisher in node.get_publishers_info_by_topic(topic)
    }


def test_user_can_run_a_separate_robot_state_publisher(ros_domain: int, tmp_path: Path) -> None:
    with running(tmp_path, "--hardware", "mock", "--no-robot-state-publisher"):
        rclpy.init()
        node, executor = Node("client"), SingleThreadedExecutor()
        executor.add_node(node)
        last = ("joint_state_broadcaster", "/joint_states")  # These messages arrive after those that must not arrive.
        until(lambda: executor.spin_once(timeout_sec=0.1) or last in _publishers(node))
        nodes, topics = node.get_node_names(), dict(node.get_topic_names_and_types())
        node.destroy_node()
        rclpy.try_shutdown()
    assert "robot_state_publisher" not in nodes
    assert not {"/tf", "/tf_static"} & set(topics)
