"""What goes out through a Topic is what comes in at a subscriber, and Python goes on meanwhile."""

import time
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from nodes import topic
from nodes.session import client_session
from nodes.topic import Topic

pytestmark = pytest.mark.ros

STATE = JointState(name=["a", "b"], position=[1.0, -2.5], velocity=[float("inf")], effort=[])
STATE.header.frame_id = "base_link"
REPORT = DiagnosticArray(
    status=[DiagnosticStatus(level=b"\x01", name="ä", values=[KeyValue(key="k", value="v" * 1000)])]
)


@pytest.fixture
def session(ros_domain: int) -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    with client_session("test_topic") as session:
        yield session


@pytest.mark.parametrize("message", [STATE, REPORT, String(data=""), String(data="x" * 100_000)], ids=lambda m: "")
def test_a_message_arrives_whole(session: tuple[Node, SingleThreadedExecutor], message: Any) -> None:
    node, executor = session
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    out = Topic(node, type(message), "/out", qos)
    assert out.listeners == 0
    heard: list[Any] = []
    node.create_subscription(type(message), "/out", heard.append, qos)
    out.publish(message)
    deadline_s = time.monotonic() + 30.0
    while not heard and time.monotonic() < deadline_s:
        executor.spin_once(timeout_sec=0.1)
    assert heard == [message]
    assert out.listeners == 1


def test_another_kind_of_message_is_refused(session: tuple[Node, SingleThreadedExecutor]) -> None:
    with pytest.raises(TypeError, match="/out takes String, not JointState"):
        Topic(session[0], String, "/out").publish(STATE)


def test_the_middleware_is_called_without_the_interpreters_lock() -> None:
    """As a function of ctypes.CDLL is, and one of ctypes.PyDLL is not."""
    assert not topic._publish._flags_ & 0x4  # FUNCFLAG_PYTHONAPI
