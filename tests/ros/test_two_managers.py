"""Two controller managers with the same name in one domain: the newer stack does not start or ends, and the older stack
continues."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from nodes.manager.only_manager import MANAGER
from nodes.only_one import NEW_CHECKS, STATUS
from tests.ros.manager_client import manager_client
from tests.ros.stack_process import StackProcess, running, until

pytestmark = pytest.mark.slow

MOCK = ("--hardware", "mock")
REMEDY = "stop the other stack, or choose another --namespace or another ROS_DOMAIN_ID"


@contextmanager
def foreign_manager() -> Iterator[None]:
    """Run a node with the name of ros2_control's controller manager in the root namespace."""
    node = Node(MANAGER)
    try:
        yield
    finally:
        node.destroy_node()


def test_second_stack_is_refused_in_the_same_namespace_only(ros_domain: int, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    with running(tmp_path, *MOCK, "--namespace", "left") as first:
        second = StackProcess(tmp_path / "second.log", "up", *MOCK, "--namespace", "left")
        assert second.process.wait(60.0) == 1
        assert "servoloop: another node is named /left/controller_manager" in second.words
        assert REMEDY in second.words and "Traceback" not in second.words
        with running(other, *MOCK, "--namespace", "right"):
            assert first.process.poll() is None
    assert first.process.returncode == 0
    assert "another node" not in first.words


def test_stack_starts_after_another_was_killed(ros_domain: int, tmp_path: Path) -> None:
    with manager_client() as client:
        with running(tmp_path, *MOCK) as killed:
            client.spin_until(lambda: (MANAGER, "/") in client.node.get_node_names_and_namespaces())
            killed.end(signal.SIGKILL)
        (tmp_path / "ready").unlink()
        names = client.node.get_node_names_and_namespaces()
        assert (MANAGER, "/") in names, "the killed stack is still in the graph of an old program"
        with running(tmp_path, *MOCK) as stack:
            assert "another node" not in stack.words


def test_new_stack_that_discovers_another_late_stops_its_arm_and_ends(ros_domain: int, tmp_path: Path) -> None:
    with manager_client(), running(tmp_path, *MOCK) as stack, foreign_manager():
        assert stack.process.wait(60.0) == 1
        assert f"the stack ends: another node is named /{MANAGER}" in stack.words
        assert REMEDY in stack.words and "Traceback" not in stack.words
        assert "holds its position with torque enabled" in stack.words


def test_old_stack_reports_another_one_and_goes_on(ros_domain: int, tmp_path: Path) -> None:
    with manager_client() as client, running(tmp_path, *MOCK) as stack:
        levels: list[int] = []

        def note(message: DiagnosticArray) -> None:
            levels.extend(status.level[0] for status in message.status if status.name == STATUS)

        client.node.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
        client.spin_until(lambda: len(levels) > NEW_CHECKS + 1)  # The node reports as often as it checks.
        assert set(levels) == {0}
        with foreign_manager():
            client.spin_until(lambda: levels[-1] == 1)
        client.spin_until(lambda: levels[-1] == 0)
        assert stack.process.poll() is None
        assert stack.words.count("another node is named /controller_manager") == 1
    assert stack.process.returncode == 0


def test_second_topic_host_is_refused(ros_domain: int, tmp_path: Path) -> None:
    logs = [tmp_path / "first.log", tmp_path / "second.log"]
    first = StackProcess(logs[0], "topic-host", *MOCK)
    try:
        until(lambda: "ready:" in first.words, lambda: first.process.poll() is not None and first.words)
        second = StackProcess(logs[1], "topic-host", *MOCK)
        assert second.process.wait(60.0) == 1
        assert "servoloop: another node is named /servoloop_topic_host" in second.words
        assert "Traceback" not in second.words
    finally:
        assert first.end() == 0, first.words
