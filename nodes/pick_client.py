"""A client of the pick-place action, as ``servoloop pick`` and the demo use it."""

from collections.abc import Callable
from dataclasses import dataclass

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from sorting_arm_interfaces.action import PickPlace

ACTION = "/sorting/arm/pick_place"
ANSWER_S = 5.0


@dataclass(frozen=True, slots=True)
class PickOutcome:
    """How a job ended; ``message`` is the node's, or says why there is none."""

    success: bool
    message: str


class PickClient:
    """Sends one goal at a time. The caller's thread spins ``executor``, which has ``node``."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self._client = ActionClient(node, PickPlace, ACTION)
        self._executor = executor

    def wait(self, timeout_s: float) -> bool:
        """Whether the node's action server is there within the time."""
        return bool(self._client.wait_for_server(timeout_s))

    def pick(self, grade: str, on_phase: Callable[[str, str], None], stop: Callable[[], bool]) -> PickOutcome:
        """Run one job to its end; ``stop`` becoming true cancels it."""
        goal = PickPlace.Goal(grade=grade)
        answer = self._client.send_goal_async(
            goal, feedback_callback=lambda m: on_phase(m.feedback.phase, m.feedback.message)
        )
        self._executor.spin_until_future_complete(answer, timeout_sec=ANSWER_S)
        if not answer.done():
            return PickOutcome(False, f"no answer from {ACTION} within {ANSWER_S:.0f} s")
        handle: ClientGoalHandle = answer.result()
        if not handle.accepted:
            return PickOutcome(False, "rejected: the node is busy or disabled, or the grade is empty")
        return self._wait_for_result(handle, stop)

    def _wait_for_result(self, handle: ClientGoalHandle, stop: Callable[[], bool]) -> PickOutcome:
        result: Future = handle.get_result_async()
        canceling = False
        while not result.done():
            self._executor.spin_once(timeout_sec=0.1)
            if stop() and not canceling:
                canceling = True
                handle.cancel_goal_async()
        response = result.result()
        success = response.status == GoalStatus.STATUS_SUCCEEDED and response.result.success
        return PickOutcome(bool(success), str(response.result.message))
