"""Check whether an action server still responds, because the middleware detects a killed node only after 20 s."""

from time import monotonic
from typing import Final

from action_msgs.srv import CancelGoal
from rclpy.node import Node
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

PULSE_S: Final = 0.25
"""Period of the requests, in seconds."""
LOST_S: Final = 1.0
"""Time after which a request without a response is repeated, in seconds. The server may be slow."""
_NO_GOAL: Final = CancelGoal.Request()
"""Request that cancels a goal that does not exist. Every action server responds to such a request, and the request has
no other effect."""
_NO_GOAL.goal_info.goal_id = UUID(uuid=[0xFF] * 16)


class ServerPulse:
    """Liveness requests to one action server, one at a time. The caller spins the node's executor."""

    def __init__(self, node: Node, action: str) -> None:
        self._client = node.create_client(CancelGoal, f"{action}/_action/cancel_goal")
        self._answer: Future | None = None
        self.begin()

    def begin(self) -> None:
        """Start watching a server that has just responded."""
        self._forget()
        self._answered_s = monotonic()
        self._asked_s = 0.0

    def silent_s(self) -> float:
        """Return the time since the server last responded, in seconds, and send the next request when it is due."""
        now_s = monotonic()
        if self._answer is not None and self._answer.done():
            self._answer, self._answered_s = None, now_s
        waits_s = PULSE_S if self._answer is None else LOST_S
        if now_s - self._asked_s >= waits_s:
            self._forget()
            self._answer, self._asked_s = self._client.call_async(_NO_GOAL), now_s
        return now_s - self._answered_s

    def _forget(self) -> None:
        if self._answer is not None:
            self._client.remove_pending_request(self._answer)
            self._answer = None
