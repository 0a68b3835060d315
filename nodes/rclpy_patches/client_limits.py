"""What clients may ask of this process: messages of a limited size, and a limited number of goals a second.

What is beyond that is refused before it is turned into Python, which costs a fraction of reading and planning it.
"""

import logging
import sys
from collections.abc import Callable
from time import monotonic
from typing import Final

from rclpy.action import ActionServer

from nodes.rclpy_patches.fair_rate import FairRate

LOG = logging.getLogger("servoloop.nodes")

PARAMETER: Final = "max_message_size"
GOALS_PER_S, BURST = 100.0, 10
"""Goals of all clients that are read in a second, and of one client at once. Each takes some milliseconds."""
REFUSALS_PER_S, REFUSALS_AT_ONCE = 100.0, 5
"""Goals beyond that which are answered in a second, and at once. The others wait; other clients' answers pass them."""
STATUSES_PER_S, STATUSES_AT_ONCE = 5.0, 10
"""How often an action publishes the status of its goals. Each message has all goals of the last ten seconds."""
TELL_AGAIN_S: Final = 1.0
"""A client that is refused again and again is reported once in this time."""
TOO_OFTEN: Final = (
    f"goals come too often: of {GOALS_PER_S:g} a second each client has its share; send fewer, or a trajectory of many "
    "points"
)


class ClientLimits:
    """All calls come from the ROS thread."""

    def __init__(self) -> None:
        self.bytes = sys.maxsize
        """The limit of a message's size in memory; the manager's node sets it."""
        self.goals = FairRate(GOALS_PER_S, BURST)
        self.refusals = FairRate(REFUSALS_PER_S, REFUSALS_AT_ONCE)
        self.statuses = FairRate(STATUSES_PER_S, STATUSES_AT_ONCE)
        """By action."""
        self.on_refused: dict[str, Callable[[str], None]] = {}
        """By topic or action: a function that is told why a message is refused."""
        self.actions: dict[int, str] = {}
        """The names of actions by their servers' pointers: of an action rcl knows the name that is not expanded."""
        self._told_s: dict[str, float] = {}

    def add_action(self, server: ActionServer, name: str) -> None:
        """Make the name of an action known, for messages about its goals."""
        self.actions[server._handle.pointer] = name

    def refuse_size(self, name: str) -> None:
        """Report that a message on this topic, service or action is too large."""
        megabytes = f"{self.bytes / 1e6:g} MB"
        self._refuse(
            name, f"it is larger than {megabytes}: send less at a time, or raise {PARAMETER} of /controller_manager"
        )

    def refuse_rate(self, name: str) -> None:
        """Report that goals come too often."""
        self._refuse(name, TOO_OFTEN)

    def _refuse(self, name: str, reason: str) -> None:
        now_s = monotonic()
        if now_s - self._told_s.get(name, -TELL_AGAIN_S) < TELL_AGAIN_S:
            return
        self._told_s[name] = now_s
        LOG.error("%s: a message is refused before it is read: %s", name, reason)
        if tell := self.on_refused.get(name):
            tell(reason)


CLIENT_LIMITS: Final = ClientLimits()
"""The limits of this process: the patches of rclpy that they are for are the whole process's, too."""
