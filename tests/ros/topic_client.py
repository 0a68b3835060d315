"""A client in the process of the test that receives topics and sends commands to the forward controllers."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import rclpy
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from tests.ros.manager_client import ManagerClient

EVERY: Final = 1000
"""Queue depth of a subscriber that must not miss a message."""
CYCLES: Final = 5
"""Number of states in which the effect of a wrongly executed command would be visible."""


MATCH_S = 0.2
"""Time for controllers to discover a new publisher, in seconds. Best-effort subscribers miss messages that were sent
before."""


class TopicClient(ManagerClient):
    """Client that stores received messages until ``spin_until`` has returned."""

    def __init__(self) -> None:
        super().__init__("topic_client")
        self._commands: dict[str, Publisher] = {}

    def some(
        self, kind: Any, topic: str, count: int, wanted: Callable[[Any], bool] = lambda m: True, qos: Any = 10
    ) -> list[Any]:
        """Return the first messages that satisfy ``wanted``."""
        with self.hearing(kind, topic, qos) as seen:
            self.spin_until(lambda: len(list(filter(wanted, seen))) >= count)
        return list(filter(wanted, seen))

    def first(self, kind: Any, topic: str, wanted: Callable[[Any], bool] = lambda m: True, qos: Any = 10) -> Any:
        """Return the first message that satisfies ``wanted``."""
        return self.some(kind, topic, 1, wanted, qos)[0]

    def send(self, controller: str, *values: float) -> None:
        """Send a command to a forward controller after the controller has discovered the publisher."""
        if controller not in self._commands:
            self._commands[controller] = self.node.create_publisher(Float64MultiArray, f"/{controller}/commands", 10)
            self.spin_until(lambda: self._commands[controller].get_subscription_count() == 1)
            time.sleep(MATCH_S)
        self._commands[controller].publish(Float64MultiArray(data=list(values)))

    def arrives(self, **places: float) -> None:
        """Wait until the joints have reached these positions."""
        self.first(JointState, "/joint_states", lambda m: all(_near(m, name, at) for name, at in places.items()))

    def stays(self, **places: float) -> None:
        """Check that the joints stay at these positions in each of the next states."""
        states = self.some(JointState, "/joint_states", CYCLES)
        assert [name for state in states for name, at in places.items() if not _near(state, name, at)] == []


def place(state: JointState, joint: str) -> float:
    """Return the position of a joint, in rad or m."""
    return float(state.position[state.name.index(joint)])


def _near(state: JointState, joint: str, at: float) -> bool:
    return abs(place(state, joint) - at) < 1e-6


@contextmanager
def topic_client() -> Iterator[TopicClient]:
    """Provide a client with its own ROS context."""
    rclpy.init()
    client = TopicClient()
    try:
        yield client
    finally:
        client.close()
        rclpy.try_shutdown()
