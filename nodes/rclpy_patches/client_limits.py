"""Limit the size of messages and the rate of goals that this process accepts from clients.

Messages that exceed the limits are rejected before conversion to Python. A rejection takes only a fraction of the time
needed to read the message and plan.
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
"""Maximum number of goals that are read per second from all clients together, and maximum number in one burst from a
single client. Reading a goal takes a few milliseconds."""
REFUSALS_PER_S, REFUSALS_AT_ONCE = 100.0, 5
"""Maximum number of rejections that are sent per second, and maximum number in one burst. Further rejections are
delayed, without delaying other responses."""
STATUSES_PER_S, STATUSES_AT_ONCE = 5.0, 10
"""Rate and burst size of an action's status messages. Each status message contains all goals of the last 10 s."""
REPORT_INTERVAL_S: Final = 1.0
"""Minimum time between two reports about rejected messages on one topic, service or action, in seconds."""
TOO_OFTEN: Final = (
    f"goals come too often. All clients share {GOALS_PER_S:g} goals per second. Send fewer goals, or a trajectory with "
    "many points"
)


class ClientLimits:
    """Limits for the clients of this process. All methods must be called from the ROS thread."""

    def __init__(self) -> None:
        self.bytes = sys.maxsize
        """Maximum size of a message in memory, in bytes. The controller manager node sets this limit."""
        self.goals = FairRate(GOALS_PER_S, BURST)
        self.refusals = FairRate(REFUSALS_PER_S, REFUSALS_AT_ONCE)
        self.statuses = FairRate(STATUSES_PER_S, STATUSES_AT_ONCE)
        """Rate of status messages, keyed by action."""
        self.on_refused: dict[str, Callable[[str], None]] = {}
        """Function that receives the reason for a rejection, keyed by topic or action name."""
        self.actions: dict[int, str] = {}
        """Resolved action names, keyed by the server pointers, because rcl knows only the unresolved names."""
        self._reported_s: dict[str, float] = {}

    def add_action(self, server: ActionServer, name: str) -> None:
        """Register an action's name for messages about its goals."""
        self.actions[server._handle.pointer] = name

    def refuse_size(self, name: str) -> None:
        """Report that a message on a topic, service or action is too large."""
        megabytes = f"{self.bytes / 1e6:g} MB"
        self._refuse(
            name, f"it is larger than {megabytes}. Send smaller messages, or raise {PARAMETER} of /controller_manager"
        )

    def refuse_rate(self, name: str) -> None:
        """Report that clients send goals too frequently."""
        self._refuse(name, TOO_OFTEN)

    def _refuse(self, name: str, reason: str) -> None:
        now_s = monotonic()
        if now_s - self._reported_s.get(name, -REPORT_INTERVAL_S) < REPORT_INTERVAL_S:
            return
        self._reported_s[name] = now_s
        LOG.error("%s: a message was rejected before it was read: %s", name, reason)
        if callback := self.on_refused.get(name):
            callback(reason)


CLIENT_LIMITS: Final = ClientLimits()
"""Limits of this process. These limits are global, like the patches of rclpy that apply them."""
