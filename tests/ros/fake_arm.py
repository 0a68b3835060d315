"""Fake arm and hand for the pick-and-place node. The arm follows a plan."""

import threading
import time
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float64MultiArray

ARM_ACTION = "/arm_controller/follow_joint_trajectory"
HAND_TOPIC = "/hand_controller/commands"
SILENT_SERVO = "servo 3 (joint3) is silent"
MOTION_S = 0.05


class Plan(Enum):
    """Behavior of the arm for one goal."""

    SUCCEED = auto()
    REJECT = auto()
    ABORT = auto()
    HOLD = auto()
    """Move until the goal is canceled."""
    ANSWER_LATE = auto()
    """Delay the response to the goal until ``FakeArm.go_on``, then hold."""
    REFUSE_CANCEL = auto()
    """Reject cancel requests, move until ``FakeArm.go_on``, and then succeed."""


@dataclass
class FakeArm:
    """Arm that records every goal and gripper value with its time, in ns since 1970.

    The node of the arm needs a single-threaded executor.
    """

    node: Node
    plans: list[Plan] = field(default_factory=list)
    """Plans for the next goals, in order. Goals without a plan succeed."""
    goals: list[tuple[int, Any]] = field(default_factory=list)
    ended_ns: list[int] = field(default_factory=list)
    canceled: int = 0
    hand: list[tuple[int, list[float]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._plan = Plan.SUCCEED
        self._answer = threading.Event()
        self._end = Future()
        self._server = ActionServer(
            self.node,
            FollowJointTrajectory,
            ARM_ACTION,
            self._execute,
            goal_callback=self._on_goal,
            cancel_callback=self._on_cancel,
        )
        self.node.create_subscription(Float64MultiArray, HAND_TOPIC, self._on_hand, 10)

    def forget(self, *plans: Plan) -> None:
        """Clear the records, and set plans for the next goals."""
        for notes in (self.plans, self.goals, self.ended_ns, self.hand):
            notes.clear()
        self.canceled = 0
        self._answer.clear()
        self.plans.extend(plans)

    def go_on(self) -> None:
        """Send a delayed response, or end a motion whose cancel request was rejected. Thread-safe."""
        self._answer.set()
        self.node.executor.create_task(self._end_motion)

    def close(self) -> None:
        """Destroy the action servers explicitly, because ``destroy_node`` leaves them."""
        self._server.destroy()

    def _end_motion(self) -> None:
        if self._plan is Plan.REFUSE_CANCEL:
            self._end.set_result(None)

    def _on_goal(self, goal: Any) -> GoalResponse:
        self.goals.append((time.time_ns(), goal))
        self._plan = self.plans.pop(0) if self.plans else Plan.SUCCEED
        if self._plan is Plan.ANSWER_LATE:
            self._answer.wait(30.0)
        self._end = Future()
        return GoalResponse.REJECT if self._plan is Plan.REJECT else GoalResponse.ACCEPT

    def _on_cancel(self, _: Any) -> CancelResponse:
        self.canceled += 1
        if self._plan is Plan.REFUSE_CANCEL:
            return CancelResponse.REJECT
        self._end.set_result(None)
        return CancelResponse.ACCEPT

    async def _execute(self, handle: Any) -> Any:
        result = FollowJointTrajectory.Result()
        if self._plan in (Plan.SUCCEED, Plan.ABORT):
            time.sleep(MOTION_S)
        else:
            await self._end
        if self._plan is Plan.ABORT:
            result.error_code, result.error_string = -4, SILENT_SERVO
            handle.abort()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.succeed()
        self.ended_ns.append(time.time_ns())
        return result

    def _on_hand(self, message: Any, info: Any) -> None:
        # The time of sending is used, because a later goal may be handled first.
        self.hand.append((info["source_timestamp"], list(message.data)))
