"""Define what a running stack needs from its ROS interface, and replace it on a machine without ROS."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final, Protocol

from hal.types import JointState
from nodes.ros_environment import RosMissing, require_ros

if TYPE_CHECKING:
    from nodes.only_one import Search

POLL_S: Final = 0.02
"""Period at which ``WithoutRos.spin`` checks for the end, in seconds."""


class RosInterface(Protocol):
    """ROS interface of a stack. The loop thread calls ``post`` and waits; the main thread calls the other methods."""

    def post(self, state: JointState) -> None:
        """Pass on a completed cycle without blocking."""
        ...

    def wake(self) -> None:
        """Respond to clients whose requests are complete. Does not block."""
        ...

    def wait_until_published(self, longest_s: float) -> bool:
        """Wait at most ``longest_s`` seconds until all cycles are published, and return whether they are."""
        ...

    def spin(self, stop: Callable[[], bool]) -> None:
        """Serve clients until ``stop`` returns True. Raises RosError if the stack must end because of another one."""
        ...

    def finish(self) -> None:
        """Send the last results after the control loop has ended."""
        ...

    def close(self) -> None: ...


class WithoutRos:
    """ROS interface of a stack that runs without ROS. It has no clients."""

    def post(self, state: JointState) -> None:
        """Do nothing."""

    def wake(self) -> None:
        """Do nothing."""

    def wait_until_published(self, longest_s: float) -> bool:
        """Return True, because no cycle waits for publication."""
        return True

    def spin(self, stop: Callable[[], bool]) -> None:
        """Wait until ``stop`` returns True."""
        while not stop():
            time.sleep(POLL_S)

    def finish(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


@contextmanager
def search_for_others(name: str, message: str, namespace: str, ros: bool = True) -> Iterator["Search | None"]:
    """Begin to search for another node with the name of a node of the stack.

    Begin the search before the hardware is opened, because it takes time. The result is None without ROS.

    Args:
        name: Name of the node.
        message: Error message if there is such a node. The braces stand for its full name.
        namespace: Namespace of the node; empty for the root namespace.
        ros: Whether the stack uses ROS.

    Raises:
        RosError: ROS is installed, but cannot be used.
    """
    try:
        if ros:
            require_ros()
    except RosMissing:
        ros = False
    if not ros:
        yield None
        return
    from nodes.only_one import Search

    with Search(name, namespace, message) as search:
        yield search
