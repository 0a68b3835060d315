"""The arm and the hand as a job sees them: goals and commands to the controllers below."""

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

from nodes.pick_place.job import Outcome
from nodes.pick_place.settings import Settings
from nodes.pick_place.waiter import Waiter

ARM_ACTION = "/arm_controller/follow_joint_trajectory"
HAND_TOPIC = "/hand_controller/commands"
_POLL_S = 0.05
_STATUS = {GoalStatus.STATUS_ABORTED: "aborted", GoalStatus.STATUS_CANCELED: "canceled the goal"}


class RosArm:
    """The arm and the hand over ROS: one motion at a time, all in the executor's thread."""

    def __init__(self, node: Node, settings: Settings) -> None:
        self._settings = settings
        self._waiter = Waiter(node)
        self._client = ActionClient(node, FollowJointTrajectory, ARM_ACTION)
        self._hand = node.create_publisher(Float64MultiArray, HAND_TOPIC, 10)
        self._stop = Future()

    def look(self, timeout_s: float) -> bool:
        """True if the arm's action server shows up in time. Blocks."""
        return bool(self._client.wait_for_server(timeout_s))

    def hand(self, position_m: float) -> None:
        """Fire and forget."""
        self._hand.publish(Float64MultiArray(data=[position_m]))

    def stop(self) -> None:
        """Cancel the running motion, if there is one."""
        if not self._stop.done():
            self._stop.set_result(None)

    async def move(self, positions_rad: Sequence[float]) -> Outcome:
        """Send one goal and see it through; bounded by the settings' time-outs."""
        self._stop = Future()
        found = await self._server_is_there()
        if self._stop.done():
            return Outcome(False)
        if not found:
            return self._late(f"the action server {ARM_ACTION} is not there", "server")
        sent = self._client.send_goal_async(self._goal(positions_rad))
        if not await self._waiter.until(self._settings.goal_timeout_s, sent):
            sent.add_done_callback(_cancel_if_accepted)
            return self._late("the arm did not answer the goal", "goal")
        if not sent.result().accepted:
            return Outcome(False, "the arm rejected the goal; its log says why")
        return await self._outcome(sent.result())

    async def _server_is_there(self) -> bool:
        for _ in range(round(self._settings.server_timeout_s / _POLL_S)):
            if self._client.server_is_ready() or self._stop.done():
                break
            await self._waiter.until(_POLL_S, self._stop)
        return bool(self._client.server_is_ready())

    async def _outcome(self, goal: Any) -> Outcome:
        result, there = goal.get_result_async(), self._client.server_is_ready
        if not await self._waiter.until_moved(self._settings.result_timeout_s, there, result, self._stop):
            goal.cancel_goal_async()
            return self._unfinished("the arm did not finish; its goal is canceled", "result")
        if not result.done():  # told to stop
            goal.cancel_goal_async()
            if not await self._waiter.until_moved(self._settings.cancel_timeout_s, there, result):
                return self._unfinished("the arm did not confirm that it stopped", "cancel")
        return _outcome_of(result.result(), stopped=self._stop.done())

    def _goal(self, positions_rad: Sequence[float]) -> Any:
        duration = Duration(seconds=self._settings.move_time_s).to_msg()
        point = JointTrajectoryPoint(positions=list(positions_rad), time_from_start=duration)
        goal = FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = list(self._settings.joints)
        goal.trajectory.points = [point]
        return goal

    def _unfinished(self, what: str, which: str) -> Outcome:
        if self._client.server_is_ready():
            return self._late(what, which)
        return Outcome(False, f"the action server {ARM_ACTION} is gone in mid-motion: the stack's log may say why")

    def _late(self, what: str, which: str) -> Outcome:
        seconds = getattr(self._settings, f"{which}_timeout_s")
        return Outcome(False, f"{what} (waited {seconds:g} s)")


def _outcome_of(response: Any, *, stopped: bool) -> Outcome:
    if response.status == GoalStatus.STATUS_SUCCEEDED:
        return Outcome(True)
    if stopped and response.status == GoalStatus.STATUS_CANCELED:
        return Outcome(False)
    what = _STATUS.get(response.status, f"ended with status {response.status}")
    why = response.result.error_string or f"error code {response.result.error_code}, no text"
    return Outcome(False, f"the arm {what}: {why}")


def _cancel_if_accepted(sent: Future) -> None:
    """An answer after the time-out: nobody waits for that motion any more."""
    if sent.result() is not None and sent.result().accepted:
        sent.result().cancel_goal_async()
