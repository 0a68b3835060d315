"""The largest message that clients may send, in the whole process: what is larger is refused before it is read."""

import logging
import sys
from collections.abc import Callable
from time import monotonic
from typing import Final

from rclpy.action import ActionServer

LOG = logging.getLogger("servoloop.nodes")

PARAMETER: Final = "max_message_size"
TELL_AGAIN_S: Final = 1.0
"""A client that sends one after the other is reported once in this time."""


class SizeLimit:
    """All calls come from the ROS thread."""

    def __init__(self) -> None:
        self.bytes = sys.maxsize
        """The limit of a message's size in memory; the manager's node sets it."""
        self.on_refused: dict[str, Callable[[str], None]] = {}
        """By topic or action: a function that is told why a message is refused."""
        self.actions: dict[int, str] = {}
        """The names of actions by their servers' pointers: of an action rcl knows the name that is not expanded."""
        self._told_s: dict[str, float] = {}

    def add_action(self, server: ActionServer, name: str) -> None:
        """Make the name of an action known, for messages about its goals."""
        self.actions[server._handle.pointer] = name

    def refuse(self, name: str) -> None:
        """Report that a message on this topic, service or action is too large."""
        megabytes = f"{self.bytes / 1e6:g} MB"
        reason = f"it is larger than {megabytes}: send less at a time, or raise {PARAMETER} of /controller_manager"
        if tell := self.on_refused.get(name):
            tell(reason)
        now_s = monotonic()
        if now_s - self._told_s.get(name, -TELL_AGAIN_S) >= TELL_AGAIN_S:
            self._told_s[name] = now_s
            LOG.error("%s: a message is refused before it is read: %s", name, reason)


SIZE_LIMIT: Final = SizeLimit()
"""The limit of this process: the patches of rclpy that it is for are the whole process's, too."""
