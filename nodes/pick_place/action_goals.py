"""Send goals to one action server, one at a time, and wait for each outcome within the configured timeouts."""

from collections.abc import Callable
from typing import Any, Final

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future

from nodes.pick_place.waiter import Waiter
from pick_place.job import JobOutcome
from pick_place.settings import ArmSettings

_STATUS: Final = {GoalStatus.STATUS_ABORTED: "aborted", GoalStatus.STATUS_CANCELED: "canceled the goal"}


class SentGoals:
    """Goals for one action server. All methods must be called from the executor thread."""

    def __init__(
        self, node: Node, settings: ArmSettings, action: tuple[type, str], reason: Callable[[Any], str]
    ) -> None:
        """Create the client.

        Args:
            node: Node of the client.
            settings: Timeouts.
            action: Type and name of the action.
            reason: Function that returns the reason for a failure from the result of a goal.
        """
        self._settings = settings
        self._waiter = Waiter(node)
        self._type, self._name = action[0], node.resolve_service_name(action[1])
        self._client = ActionClient(node, self._type, self._name)
        self._reason = reason
        self._stop = Future()

    def wait_for_server(self, timeout_s: float) -> bool:
        """Block until the action server appears, and return whether it appeared in time."""
        return bool(self._client.wait_for_server(timeout_s))

    def stop(self) -> None:
        """Cancel the running goal, if any."""
        if not self._stop.done():
            self._stop.set_result(None)

    async def send(self, goal: Any, more_s: float = 0.0) -> JobOutcome:
        """Send one goal and wait for its outcome. ``more_s`` is added to the maximum time to wait for the result."""
        self._stop = Future()
        server_s = self._settings.server_timeout_s
        found = await self._waiter.until_ready(server_s, self._client.server_is_ready, self._stop)
        if self._stop.done():
            return JobOutcome(False)
        if not found:
            return self._late(f"the action server {self._name} is not available", server_s)
        sent = self._client.send_goal_async(goal)
        if not await self._waiter.until(self._settings.goal_timeout_s, sent):
            sent.add_done_callback(_cancel_if_accepted)
            return self._late("the arm did not respond to the goal", self._settings.goal_timeout_s)
        if not sent.result().accepted:
            return JobOutcome(False, "the arm rejected the goal; the log of the stack contains the reason")
        return await self._outcome(sent.result(), self._settings.result_timeout_s + more_s)

    async def _outcome(self, goal: Any, timeout_s: float) -> JobOutcome:
        result, is_available = goal.get_result_async(), self._client.server_is_ready
        if not await self._waiter.until_moved(timeout_s, is_available, result, self._stop):
            goal.cancel_goal_async()
            return self._unfinished("the arm did not finish in time; its goal is canceled", timeout_s)
        if not result.done():  # stop() was called.
            goal.cancel_goal_async()
            cancel_timeout_s = self._settings.cancel_timeout_s
            if not await self._waiter.until_moved(cancel_timeout_s, is_available, result):
                return self._unfinished("the arm did not confirm that it stopped", cancel_timeout_s)
        return self._outcome_of(result.result())

    def _outcome_of(self, response: Any) -> JobOutcome:
        if response.status == GoalStatus.STATUS_SUCCEEDED:
            return JobOutcome(True)
        if self._stop.done() and response.status == GoalStatus.STATUS_CANCELED:
            return JobOutcome(False)
        what = _STATUS.get(response.status, f"ended with status {response.status}")
        return JobOutcome(False, f"the arm {what}: {self._reason(response.result)}")

    def _unfinished(self, what: str, waited_s: float) -> JobOutcome:
        if self._client.server_is_ready():
            return self._late(what, waited_s)
        text = f"the action server {self._name} disappeared during the motion: check the log of the stack"
        return JobOutcome(False, text)

    def _late(self, what: str, waited_s: float) -> JobOutcome:
        return JobOutcome(False, f"{what} (waited {waited_s:g} s)")


def _cancel_if_accepted(sent: Future) -> None:
    """Cancel a goal that was accepted after the timeout, because no job waits for its motion."""
    if sent.result() is not None and sent.result().accepted:
        sent.result().cancel_goal_async()
