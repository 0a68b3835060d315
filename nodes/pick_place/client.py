"""A client of the pick-place action, as ``servoloop pick`` and the demo use it. Every wait of the client has an end."""

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import Final

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from sorting_arm_interfaces.action import PickPlace

from nodes.ros_process import spin_until_done

ACTION: Final = "/sorting/arm/pick_place"
ANSWER_S: Final = 5.0
CANCEL_S: Final = 10.0
"""For the result after a cancel: the node gives the arm 3 s to answer its goal and 2 s to confirm that it stopped."""
GONE_S: Final = 2.0
"""So long the server is off the graph before the client believes it. A node that was killed leaves the graph when its
liveliness lease ends, after 20 s (Fast DDS)."""
QUIET_S: Final = 120.0
"""Without any feedback. The node speaks before each motion and waits 15 s for one at most, unless it is told other
times; one that hangs, or that was killed and started anew, stays quiet for ever."""
_SPIN_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class PickOutcome:
    """The end of a job; ``message`` is the node's, or the reason why there is none."""

    success: bool
    message: str


class PickClient:
    """Sends one goal at a time. The caller's thread spins ``executor``, which has ``node``."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self._client = ActionClient(node, PickPlace, ACTION)
        self._executor = executor
        self._heard_s = 0.0

    def wait(self, timeout_s: float, stop: Callable[[], bool] = lambda: False) -> bool:
        """Whether the node's action server is there within the time, and before ``stop`` becomes true."""
        deadline_s = monotonic() + timeout_s
        while not (there := self._client.server_is_ready()) and not stop() and monotonic() < deadline_s:
            self._executor.spin_once(timeout_sec=_SPIN_S)
        return bool(there)

    def pick(self, grade: str, on_phase: Callable[[str, str], None], stop: Callable[[], bool]) -> PickOutcome:
        """Run one job to its end; ``stop`` becoming true cancels it."""

        def hear(message: PickPlace.Impl.FeedbackMessage) -> None:
            self._heard_s = monotonic()
            on_phase(message.feedback.phase, message.feedback.message)

        self._heard_s = monotonic()
        answer = self._client.send_goal_async(PickPlace.Goal(grade=grade), feedback_callback=hear)
        if not spin_until_done(self._executor, answer, ANSWER_S):
            return PickOutcome(False, f"no answer from {ACTION} within {ANSWER_S:.0f} s: does the node hang?")
        handle: ClientGoalHandle = answer.result()
        if not handle.accepted:
            return PickOutcome(False, "rejected: the node is busy or disabled, or the grade is empty")
        return self._wait_for_result(handle, stop)

    def _wait_for_result(self, handle: ClientGoalHandle, stop: Callable[[], bool]) -> PickOutcome:
        result: Future = handle.get_result_async()
        there_s = monotonic()
        while not result.done():
            if stop():
                return self._cancel(handle, result)
            if self._client.server_is_ready():
                there_s = monotonic()
            if monotonic() - there_s > GONE_S:
                return PickOutcome(False, f"{ACTION} is gone: the node has ended, its log may say why. {_UNKNOWN}")
            if monotonic() - self._heard_s > QUIET_S:
                self._cancel(handle, result)
                return PickOutcome(False, f"{ACTION} has said nothing for {QUIET_S:.0f} s: start the node anew")
            self._executor.spin_once(timeout_sec=_SPIN_S)
        return _outcome(result)

    def _cancel(self, handle: ClientGoalHandle, result: Future) -> PickOutcome:
        handle.cancel_goal_async()
        if spin_until_done(self._executor, result, CANCEL_S):
            return _outcome(result)
        return PickOutcome(False, f"canceled, and {ACTION} did not confirm it within {CANCEL_S:.0f} s. {_UNKNOWN}")


_UNKNOWN: Final = "The arm finishes the motion under way and holds there"


def _outcome(result: Future) -> PickOutcome:
    response = result.result()
    success = response.status == GoalStatus.STATUS_SUCCEEDED and response.result.success
    return PickOutcome(bool(success), str(response.result.message))
