"""Objects of the scene in /tf, including for late subscribers."""

from collections.abc import Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from tf2_msgs.msg import TFMessage

from controller.broadcasters.joint_state_broadcaster import JointStates
from controller.manager.node_parameters import parameters_of
from drivers.clock import MonotonicClock
from hal.robot_description.description import Description
from nodes.robot_state_publisher import RobotStatePublisher
from nodes.ros_time import RosTime
from tests.ros.stack_process import until
from tests.ros.stamps import time_message

CYCLE_S = 0.05


class EmptyRobot:
    """A robot state publisher without joints that counts how often it reads the scene."""

    def __init__(self, parameters: dict[str, Any]) -> None:
        self.looks = 0
        content = {"robot_state_publisher": {"ros__parameters": parameters}}
        file = SimpleNamespace(parameters=partial(parameters_of, content))
        factory = SimpleNamespace(file=file)
        stack: Any = SimpleNamespace(description=Description("", {}), factory=factory, scene=self._scene, namespace="")
        self.publisher = RobotStatePublisher(stack, RosTime(MonotonicClock(), simulated=False))
        self._now_s = 0.0

    def _scene(self) -> dict[str, Any]:
        self.looks += 1
        return {"cube": ((0.1, 0.2, 0.3), (0.0, 0.0, 0.0, 1.0))}

    def cycle(self, count: int) -> None:
        for _ in range(count):
            self._now_s += CYCLE_S
            nothing = np.empty(0)
            states = JointStates(self._now_s, (), nothing, nothing, nothing)
            self.publisher.publish([states], time_message(self._now_s))


@pytest.fixture
def executor(ros_domain: int) -> Iterator[SingleThreadedExecutor]:
    """Remove all added entities from the graph after the test."""
    rclpy.init()
    executor = SingleThreadedExecutor()
    yield executor
    for node in executor.get_nodes():
        node.destroy_node()
    rclpy.try_shutdown()


def test_scene_is_read_once_per_second_without_subscribers(executor: SingleThreadedExecutor) -> None:
    robot = EmptyRobot({})
    executor.add_node(robot.publisher.node)
    robot.cycle(200)
    assert 9 <= robot.looks <= 12


@pytest.mark.parametrize(
    ("parameters", "looks"), [({}, 100), ({"publish_frequency": 5.0}, 25), ({"ignore_timestamp": True}, 100)]
)
def test_subscribers_receive_the_scene_with_the_links(
    executor: SingleThreadedExecutor, parameters: dict[str, Any], looks: int
) -> None:
    seen: list[TFMessage] = []
    node = Node("client")
    node.create_subscription(TFMessage, "/tf", seen.append, 200)
    executor.add_node(node)
    robot = EmptyRobot({"frame_prefix": "left/", **parameters})
    executor.add_node(robot.publisher.node)
    until(lambda: robot.publisher._tf.get_subscription_count() == 1)
    robot.looks = 0
    robot.cycle(100)
    until(lambda: executor.spin_once(timeout_sec=0.1) or bool(seen))
    (transform,) = seen[0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("left/base_link", "left/cube")
    assert transform.transform.translation.z == 0.3
    assert robot.looks == pytest.approx(looks, abs=1)


@pytest.mark.parametrize("parameters", [{"publish_frequency": 0.0}, {"frame_prefix": 7}, {"ignore_timestamp": []}])
def test_invalid_initial_parameters_are_logged_and_replaced_by_defaults(
    executor: SingleThreadedExecutor, parameters: dict[str, Any], capfd: pytest.CaptureFixture[str]
) -> None:
    robot = EmptyRobot(parameters)
    executor.add_node(robot.publisher.node)
    (name,) = parameters
    assert robot.publisher.node.get_parameter("publish_frequency").value == 20.0
    assert f"{name}: " in capfd.readouterr().err


def test_initial_parameters_without_effect_are_logged(
    executor: SingleThreadedExecutor, capfd: pytest.CaptureFixture[str]
) -> None:
    executor.add_node(EmptyRobot({"use_tf_static": True, "use_sim_time": False}).publisher.node)
    logged = capfd.readouterr().err
    assert "parameter without effect: use_tf_static" in logged and "use_sim_time" not in logged
