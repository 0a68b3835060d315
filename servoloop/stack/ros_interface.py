"""Define the ROS interface that a running stack needs, and a replacement for machines without ROS."""

import time
from collections.abc import Callable
from typing import Final, Protocol

from hal.types import JointState

POLL_S: Final = 0.02
"""Interval at which ``WithoutRos.spin`` checks whether to stop, in seconds."""


class RosInterface(Protocol):
    """ROS interface of a stack.

    The loop thread calls ``post`` and ``wait_until_published``. The main thread calls the other methods.
    """

    def post(self, state: JointState) -> None:
        """Hand over the state of a completed cycle for publication, without blocking."""
        ...

    def wake(self) -> None:
        """Respond to clients whose requests are complete, without blocking."""
        ...

    def wait_until_published(self, longest_s: float) -> bool:
        """Wait at most ``longest_s`` seconds for all cycles to be published, and return whether they were published."""
        ...

    def spin(self, stop: Callable[[], bool]) -> None:
        """Serve clients until ``stop`` returns True. Raises RosError if this stack must stop because another stack is
        running."""
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
