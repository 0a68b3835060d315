"""A client that listens to topics and sends the forward controllers their commands, in the test's own process."""

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
"""A listener's depth where no message may be missed."""
CYCLES: Final = 5
"""In so many a command that should not count would show."""


MATCH_S = 0.2
"""For the other side to know a new publisher too: controllers listen best effort, and what comes before is lost."""


class Onlooker(ManagerClient):
    """What comes in is there after ``spin_until``."""

    def __init__(self) -> None:
        super().__init__("onlooker")
        self._commands: dict[str, Publisher] = {}

    def some(
        self, kind: Any, topic: str, count: int, wanted: Callable[[Any], bool] = lambda m: True, qos: Any = 10
    ) -> list[Any]:
        """The first messages of which ``wanted`` holds."""
        with self.hearing(kind, topic, qos) as seen:
            self.spin_until(lambda: len(list(filter(wanted, seen))) >= count)
        return list(filter(wanted, seen))

    def first(self, kind: Any, topic: str, wanted: Callable[[Any], bool] = lambda m: True, qos: Any = 10) -> Any:
        """The first message of which ``wanted`` holds."""
        return self.some(kind, topic, 1, wanted, qos)[0]

    def send(self, controller: str, *values: float) -> None:
        """A command for a forward controller that is there."""
        if controller not in self._commands:
            self._commands[controller] = self.node.create_publisher(Float64MultiArray, f"/{controller}/commands", 10)
            self.spin_until(lambda: self._commands[controller].get_subscription_count() == 1)
            time.sleep(MATCH_S)
        self._commands[controller].publish(Float64MultiArray(data=list(values)))

    def arrives(self, **places: float) -> None:
        """Wait until these joints are there."""
        self.first(JointState, "/joint_states", lambda m: all(_near(m, name, at) for name, at in places.items()))

    def stays(self, **places: float) -> None:
        """These joints are there in each of the next states."""
        states = self.some(JointState, "/joint_states", CYCLES)
        assert [name for state in states for name, at in places.items() if not _near(state, name, at)] == []


def place(state: JointState, joint: str) -> float:
    """The joint's position (rad, m)."""
    return float(state.position[state.name.index(joint)])


def _near(state: JointState, joint: str, at: float) -> bool:
    return abs(place(state, joint) - at) < 1e-6


@contextmanager
def onlooker() -> Iterator[Onlooker]:
    """A client within a ROS context of its own."""
    rclpy.init()
    client = Onlooker()
    try:
        yield client
    finally:
        client.close()
        rclpy.try_shutdown()
