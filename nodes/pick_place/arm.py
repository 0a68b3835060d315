"""Move the arm and the hand of a job through the controllers of the stack."""

from collections.abc import Sequence
from typing import Any

from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectoryPoint

from nodes.pick_place.job import JobOutcome
from nodes.pick_place.settings import JobSettings
from nodes.pick_place.waiter import Waiter

ARM_ACTION = "/arm_controller/follow_joint_trajectory"
HAND_TOPIC = "/hand_controller/commands"
_POLL_S = 0.05
_STATUS = {GoalStatus.STATUS_ABORTED: "aborted", GoalStatus.STATUS_CANCELED: "canceled the goal"}


class RosArm:
    """Arm and hand over ROS, one motion at a time. All calls come from the executor thread."""

    def __init__(self, node: Node, settings: JobSettings) -> None:
        self._settings = settings
        self._waiter = Waiter(node)
        self._client = ActionClient(node, FollowJointTrajectory, ARM_ACTION)
        self._hand = node.create_publisher(Float64MultiArray, HAND_TOPIC, 10)
        self._stop = Future()

    def wait_for_server(self, timeout_s: float) -> bool:
        """Block until the action server of the arm appears, and return whether it appeared in time."""
        return bool(self._client.wait_for_server(timeout_s))

    def hand(self, position_m: float) -> None:
        """Send a position to the fingers without waiting for them."""
        self._hand.publish(Float64MultiArray(data=[position_m]))

    def stop(self) -> None:
        """Cancel the running motion, if any."""
        if not self._stop.done():
            self._stop.set_result(None)

    async def move(self, positions_rad: Sequence[float]) -> JobOutcome:
        """Send one goal and wait for its outcome, within the timeouts of the settings."""
        self._stop = Future()
        found = await self._find_server()
        if self._stop.done():
            return JobOutcome(False)
        if not found:
            return self._late(f"the action server {ARM_ACTION} is not available", "server")
        sent = self._client.send_goal_async(self._goal(positions_rad))
        if not await self._waiter.until(self._settings.goal_timeout_s, sent):
            sent.add_done_callback(_cancel_if_accepted)
            return self._late("the arm did not respond to the goal", "goal")
        if not sent.result().accepted:
            return JobOutcome(False, "the arm rejected the goal; the log of the stack contains the reason")
        return await self._outcome(sent.result())

    async def _find_server(self) -> bool:
        for _ in range(round(self._settings.server_timeout_s / _POLL_S)):
            if self._client.server_is_ready() or self._stop.done():
                break
            await self._waiter.until(_POLL_S, self._stop)
        return bool(self._client.server_is_ready())

    async def _outcome(self, goal: Any) -> JobOutcome:
        result, is_available = goal.get_result_async(), self._client.server_is_ready
        if not await self._waiter.until_moved(self._settings.result_timeout_s, is_available, result, self._stop):
            goal.cancel_goal_async()
            return self._unfinished("the arm did not finish in time; its goal is canceled", "result")
        if not result.done():  # The motion was stopped by stop().
            goal.cancel_goal_async()
            if not await self._waiter.until_moved(self._settings.cancel_timeout_s, is_available, result):
                return self._unfinished("the arm did not confirm that it stopped", "cancel")
        return _outcome_of(result.result(), stopped=self._stop.done())

    def _goal(self, positions_rad: Sequence[float]) -> Any:
        duration = Duration(seconds=self._settings.move_time_s).to_msg()
        point = JointTrajectoryPoint(positions=list(positions_rad), time_from_start=duration)
        goal = FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = list(self._settings.joints)
        goal.trajectory.points = [point]
        return goal

    def _unfinished(self, what: str, which: str) -> JobOutcome:
        if self._client.server_is_ready():
            return self._late(what, which)
        return JobOutcome(
            False, f"the action server {ARM_ACTION} disappeared during the motion: check the log of the stack"
        )

    def _late(self, what: str, which: str) -> JobOutcome:
        seconds = getattr(self._settings, f"{which}_timeout_s")
        return JobOutcome(False, f"{what} (waited {seconds:g} s)")


def _outcome_of(response: Any, *, stopped: bool) -> JobOutcome:
    if response.status == GoalStatus.STATUS_SUCCEEDED:
        return JobOutcome(True)
    if stopped and response.status == GoalStatus.STATUS_CANCELED:
        return JobOutcome(False)
    what = _STATUS.get(response.status, f"ended with status {response.status}")
    reason = response.result.error_string or f"error code {response.result.error_code} without a text"
    return JobOutcome(False, f"the arm {what}: {reason}")


def _cancel_if_accepted(sent: Future) -> None:
    """Cancel a goal that was accepted after the timeout, because no job waits for its motion."""
    if sent.result() is not None and sent.result().accepted:
        sent.result().cancel_goal_async()
