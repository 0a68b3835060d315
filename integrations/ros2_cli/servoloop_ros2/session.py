"""Provide a node for the duration of one command, and wait with timeouts."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from nodes.clients.client_node import client_node
from nodes.ros_process import spin_until_done
from servoloop_ros2.ros2_error import Ros2Error

DISCOVERY_S: Final = 1.2
"""Time to discover other programs before a list is printed, in seconds."""
SERVER_S: Final = 10.0
"""Maximum time to wait for a server and for its answer, in seconds."""
TURN_S: Final = 0.05
HIDDEN: Final = "/_"
"""Part of the names of actions' topics and services. Such names are not listed."""


class RosSession:
    """The node of a command and its executor."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self.node, self._executor = node, executor

    def spin(self, seconds: float) -> None:
        """Serve the node for a time, in seconds."""
        self.spin_until(lambda: False, seconds)

    def spin_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Serve the node until a condition is true, and return whether it became true in time."""
        end_s = time.monotonic() + timeout_s
        while not condition():
            if (left_s := end_s - time.monotonic()) <= 0.0:
                return False
            self._executor.spin_once(timeout_sec=min(TURN_S, left_s))
        return True

    def result(self, future: Future, what: str, timeout_s: float | None = SERVER_S) -> Any:
        """Wait for the result of a future. Raises Ros2Error after the timeout."""
        if not spin_until_done(self._executor, future, timeout_s):
            raise Ros2Error(f"{what} did not respond within {timeout_s:g} s: check whether its program still runs")
        return future.result()

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Call a service and return its response. Raises Ros2Error if no program serves it."""
        client = self.node.create_client(kind, name)
        if not self.spin_until(client.service_is_ready, SERVER_S):
            raise Ros2Error(
                f"no program offers the service {name}: start the program, or check the name with ros2 service list"
            )
        return self.result(client.call_async(request), name)

    def names(self, listed: Callable[[], list[tuple[str, list[str]]]]) -> Mapping[str, list[str]]:
        """Return names with their types after the discovery."""
        self.spin(DISCOVERY_S)
        return dict(sorted(listed()))


@contextmanager
def session() -> Iterator[RosSession]:
    """Provide a session within the block."""
    with client_node("ros2_command") as (node, executor):
        yield RosSession(node, executor)


def print_names(names: Mapping[str, list[str]], show_types: bool) -> None:
    """Print names that are not hidden, with their types if ``show_types`` is True."""
    for name, types in names.items():
        if HIDDEN not in name:
            print(f"{name} [{', '.join(types)}]" if show_types else name)
