"""``servoloop topic-host`` with a stand-in of ros2_control's plugin, which sends commands at 100 Hz over ROS."""

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState

from nodes.topic_host.topics import COMMANDS, STATES
from tests.pages import commands
from tests.ros.stack_process import PATIENCE_S, StackProcess
from tests.topic_host.plugin import TopicSystem

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
JOINT = "shoulder_pan"
PERIOD_S = 0.01
STATUS = "servoloop: topic host"
(HOST,) = commands("ros2-control-host.md")
"""Command of the documentation. The servos of the command are replaced by a mock."""


class PluginNode:
    """The plugin as a node, which reads and writes in each cycle, as in the controller manager."""

    def __init__(self) -> None:
        self.node = Node("plugin")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.plugin = TopicSystem(JOINTS)
        self.states: list[JointState] = []
        self.statuses: list[DiagnosticStatus] = []
        self.sent = 0
        self.node.create_subscription(JointState, STATES, self._on_state, qos_profile_sensor_data)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self.publisher = self.node.create_publisher(JointState, COMMANDS, QoSProfile(depth=1))

    def _on_state(self, message: JointState) -> None:
        self.states.append(message)
        self.plugin.read(message.name, message.position)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.statuses += [status for status in message.status if status.name == STATUS]

    def run(self, seconds: float, wanted: Callable[[float], dict[str, float]] | None = None) -> None:
        """Run cycles. Without ``wanted``, the plugin sends nothing.

        After a pause of this process, the next cycle continues where the last one ended, so that commands do not jump.
        """
        for cycle in range(round(seconds / PERIOD_S)):
            due_s = time.monotonic() + PERIOD_S
            if wanted is not None:
                self._send(wanted(cycle * PERIOD_S))
            while (left_s := due_s - time.monotonic()) > 0.0:
                self.executor.spin_once(timeout_sec=left_s)

    def _send(self, commands: dict[str, float]) -> None:
        self.plugin.commands = commands
        if (message := self.plugin.write()) is not None:
            self.sent += 1
            command = JointState(name=message.name, position=message.position)
            command.header.stamp = self.node.get_clock().now().to_msg()
            self.publisher.publish(command)

    def run_until(self, reached: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not reached():
            assert time.monotonic() < deadline_s, "never came"
            self.run(0.05)

    def phase(self) -> str:
        """Return the next report of the host about its topics."""
        self.statuses.clear()
        self.run_until(lambda: bool(self.statuses))
        return str(self.statuses[-1].message)

    def way_rad(self, seconds: float) -> float:
        """Return the distance between the extreme positions of the joint in the newest states."""
        newest = self.states[-int(seconds / PERIOD_S) :]
        positions = [state.position[state.name.index(JOINT)] for state in newest]
        return max(positions) - min(positions)


@pytest.fixture
def host(ros_domain: int, tmp_path: Path) -> Iterator[StackProcess]:
    ready = tmp_path / "ready"
    words = HOST.removeprefix("servoloop ").replace("--port /dev/ttyACM0", "--hardware mock").split()
    host = StackProcess(tmp_path / "host.log", *words, "--ready-file", str(ready))
    try:
        host.wait_for(ready)
        yield host
    finally:
        assert host.end() == 0, host.words
        assert "Traceback" not in host.words


@pytest.fixture
def plugin(host: StackProcess) -> Iterator[PluginNode]:
    rclpy.init()
    try:
        plugin = PluginNode()
        plugin.run_until(lambda: len(plugin.states) > 10 and plugin.publisher.get_subscription_count() == 1)
        yield plugin
        plugin.node.destroy_node()
    finally:
        rclpy.shutdown()


@pytest.mark.runs(HOST)
def test_the_arm_follows_commands_at_100_hz_and_holds_when_they_end(host: StackProcess, plugin: PluginNode) -> None:
    assert set(plugin.states[-1].name) == set(JOINTS) and len(plugin.states[-1].velocity) == len(JOINTS)
    plugin.run(0.3, lambda time_s: {})  # no controller is active, so the value of each joint is NaN
    assert plugin.sent > 10 and plugin.phase() == "waiting for the first command"
    middle = dict(plugin.plugin.states)
    plugin.run(3.0, lambda t: {**middle, JOINT: middle[JOINT] + 0.3 * math.sin(math.pi * t) ** 2})
    assert max(s.position[s.name.index(JOINT)] for s in plugin.states) == pytest.approx(middle[JOINT] + 0.3, abs=0.02)
    assert "would move" not in host.words
    plugin.run(0.25, lambda t: {**middle, JOINT: middle[JOINT] + 1.2})
    plugin.run(1.0)
    assert plugin.phase().startswith("holding: no command for 0.2 s while shoulder_pan was")
    assert plugin.way_rad(0.3) == 0.0


def test_the_arm_holds_when_the_sender_leaves(host: StackProcess, plugin: PluginNode) -> None:
    middle = dict(plugin.plugin.states)
    plugin.run(0.4, lambda t: {**middle, JOINT: middle[JOINT] - 0.6})
    assert plugin.way_rad(0.1) > 0.01
    plugin.node.destroy_publisher(plugin.publisher)
    plugin.run(0.4)
    assert plugin.way_rad(0.1) == 0.0
    assert plugin.phase() == f"holding: no program publishes to /{COMMANDS} any longer"


def test_a_message_for_another_arm_is_refused_once(host: StackProcess, plugin: PluginNode) -> None:
    for _ in range(20):
        plugin.publisher.publish(JointState(name=["panda_joint1"], position=[0.1]))
        plugin.run(0.02)
    refusal = f"{COMMANDS}: the command contains panda_joint1, but this arm moves {', '.join(JOINTS)}"
    assert host.words.count(refusal) == 1
    plugin.phase()
    assert {v.key: v.value for v in plugin.statuses[-1].values}["refused_messages"] not in ("0", "1")


@pytest.mark.parametrize("topic", ["robot states", COMMANDS])
def test_a_wrong_topic_is_refused_in_one_sentence(topic: str, ros_domain: int, tmp_path: Path) -> None:
    host = StackProcess(tmp_path / "log", "topic-host", "--hardware", "mock", "--states-topic", topic)
    assert host.process.wait(PATIENCE_S) == 1
    assert topic in host.words and "Traceback" not in host.words
