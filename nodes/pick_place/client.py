"""Client of the pick-place action for ``servoloop pick`` and the demo. Every wait of the client has a timeout."""

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

from nodes.pick_place.pulse import ServerPulse
from nodes.ros_process import spin_until_done

ACTION: Final = "sorting/arm/pick_place"
ANSWER_S: Final = 5.0
CANCEL_S: Final = 10.0
"""Maximum time to wait for the result after canceling, in seconds. The node waits up to 3 s for the response to its
goal and 2 s for confirmation that the arm has stopped."""
GONE_S: Final = 3.5
"""Minimum time without a response after which the server is considered lost, in seconds. A killed node leaves the graph
only when its liveliness lease expires, after 20 s (Fast DDS)."""
GONE_CANCELED_S: Final = 0.8
"""Maximum time without a response from the server after a cancel request, in seconds. This limit is shorter than
``GONE_S``, because the user is waiting for the program to exit."""
QUIET_S: Final = 120.0
"""Maximum time without feedback, in seconds. By default, the node sends feedback before each motion and waits at most
15 s for a motion to finish. A node that hangs or was restarted never sends feedback for the old goal."""
_SPIN_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class PickOutcome:
    """Outcome of a job. ``message`` comes from the node, or explains why the node did not send one."""

    success: bool
    message: str


class PickClient:
    """Client that sends one goal at a time. The methods spin ``executor``, which contains ``node``, in the caller's
    thread."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, action: str = ACTION) -> None:
        self.action = node.resolve_service_name(action)
        """Name of the action."""
        self._client = ActionClient(node, PickPlace, action)
        self._executor = executor
        self._pulse = ServerPulse(node, action)
        self._feedback_s = 0.0

    def wait(self, timeout_s: float, stop: Callable[[], bool] = lambda: False) -> bool:
        """Wait for the action server, and return whether it appeared in time and before ``stop`` returned True."""
        deadline_s = monotonic() + timeout_s
        while not (available := self._client.server_is_ready()) and not stop() and monotonic() < deadline_s:
            self._executor.spin_once(timeout_sec=_SPIN_S)
        return bool(available)

    def pick(self, grade: str, on_phase: Callable[[str, str], None], stop: Callable[[], bool]) -> PickOutcome:
        """Run one job and wait until it ends.

        Args:
            grade: Grade of the cube.
            on_phase: Function that receives the phase and message of each feedback.
            stop: Function that cancels the job when it returns True.
        """

        def on_feedback(message: PickPlace.Impl.FeedbackMessage) -> None:
            self._feedback_s = monotonic()
            on_phase(message.feedback.phase, message.feedback.message)

        self._feedback_s = monotonic()
        answer = self._client.send_goal_async(PickPlace.Goal(grade=grade), feedback_callback=on_feedback)
        if not spin_until_done(self._executor, answer, ANSWER_S):
            return PickOutcome(
                False, f"no response from {self.action} within {ANSWER_S:.0f} s: restart the node if it hangs"
            )
        handle: ClientGoalHandle = answer.result()
        if not handle.accepted:
            return PickOutcome(False, "rejected: the node is busy or disabled, or the grade is empty")
        return self._wait_for_result(handle, stop)

    def _wait_for_result(self, handle: ClientGoalHandle, stop: Callable[[], bool]) -> PickOutcome:
        result: Future = handle.get_result_async()
        self._pulse.begin()
        while not result.done():
            if stop():
                return self._cancel(handle, result)
            if self._pulse.silent_s() > GONE_S:
                return PickOutcome(
                    False, f"{self.action} disappeared: the node has exited. Check its log. {_REMAINING_MOTION}"
                )
            if monotonic() - self._feedback_s > QUIET_S:
                self._cancel(handle, result)
                return PickOutcome(False, f"{self.action} has sent no feedback for {QUIET_S:.0f} s: restart the node")
            self._executor.spin_once(timeout_sec=_SPIN_S)
        return _outcome(result)

    def _cancel(self, handle: ClientGoalHandle, result: Future) -> PickOutcome:
        handle.cancel_goal_async()
        end_s = monotonic() + CANCEL_S
        while not result.done():
            if self._pulse.silent_s() > GONE_CANCELED_S:
                return PickOutcome(False, f"canceled, but {self.action} does not respond. {_REMAINING_MOTION}")
            if monotonic() > end_s:
                text = f"canceled, but {self.action} did not confirm this within {CANCEL_S:.0f} s. {_REMAINING_MOTION}"
                return PickOutcome(False, text)
            self._executor.spin_once(timeout_sec=_SPIN_S)
        return _outcome(result)


_REMAINING_MOTION: Final = "The arm finishes its current motion and holds its position"


def _outcome(result: Future) -> PickOutcome:
    response = result.result()
    success = response.status == GoalStatus.STATUS_SUCCEEDED and response.result.success
    return PickOutcome(bool(success), str(response.result.message))
