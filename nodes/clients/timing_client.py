"""Measure the response times of a running stack: goal responses, first motions, and age of /joint_states."""

import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from drivers.driver_errors import DriverError

PATIENCE_S: Final = 30.0
POLL_S: Final = 0.05
"""Interval at which a waiting call checks whether to stop waiting, in seconds."""


@dataclass(slots=True)
class Promptness:
    """Measured times, in seconds, and number of goals."""

    answers_s: list[float] = field(default_factory=list)
    cancels_s: list[float] = field(default_factory=list)
    motions_s: list[float] = field(default_factory=list)
    stamps_s: list[float] = field(default_factory=list)
    """Stamps of /joint_states in ROS time, recorded while ``recording`` is True."""
    ages_s: list[float] = field(default_factory=list)
    """Age of each recorded message when it was received, in seconds."""
    goals: int = 0
    failed: int = 0


@dataclass(frozen=True, slots=True)
class TimedController:
    """Joint trajectory controller whose response times are measured."""

    joints: Sequence[str]
    """Names of the controller's joints."""
    name: str = "arm_controller"
    moved: float = 1e-6
    """Minimum distance after which a joint counts as moved, in rad or m."""


class TimingClient:
    """Client that sends goals to a joint trajectory controller, one at a time. The methods spin ``executor`` in the
    caller's thread."""

    def __init__(
        self,
        node: Node,
        executor: SingleThreadedExecutor,
        controller: TimedController,
        noted: Promptness,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Connect to the action server of the controller.

        Args:
            node: Node of the client.
            executor: Executor of the node, which this client spins.
            controller: The controller.
            noted: Object that stores the measurements.
            stop: Function that ends every wait when it returns True.

        Raises:
            DriverError: No node provides the controller's action.
        """
        self.recording = False
        self._executor, self._controller, self._noted, self._stop = executor, controller, noted, stop
        self._now: Callable[[], float] = lambda: node.get_clock().now().nanoseconds * 1e-9
        action = node.resolve_service_name(f"{controller.name}/follow_joint_trajectory")
        self._arm = ActionClient(node, FollowJointTrajectory, action)
        self._position: list[float] = []
        self._waiting_since_s: float | None = None
        self._start: list[float] = []
        node.create_subscription(JointState, "joint_states", self._on_state, 100)
        self._until(self._arm.server_is_ready, PATIENCE_S, f"no node offers the action {action}: start the stack first")

    def spin(self, seconds: float) -> None:
        """Serve callbacks for ``seconds`` or until ``stop`` returns True."""
        end_s = time.perf_counter() + seconds
        while (left_s := end_s - time.perf_counter()) > 0.0 and not self._stop():
            self._executor.spin_once(timeout_sec=min(left_s, POLL_S))

    def go(
        self, position: Sequence[float], seconds: float, cancel_after_s: float | None = None, period_s: float = 0.05
    ) -> None:
        """Send one goal at a random point in the stack's cycle and wait for the result.

        Args:
            position: Goal position of each joint, in rad or m.
            seconds: Duration of the motion.
            cancel_after_s: Time after which to cancel the goal, in seconds; None to let the goal finish.
            period_s: Period of the stack's control cycle, in seconds.

        Raises:
            DriverError: The stack does not respond in time.
        """
        goal = goal_to(self._controller.joints, position, seconds)
        self.spin(random.uniform(0.0, period_s))
        sent_s = self._waiting_since_s = time.perf_counter()
        self._start = self._position
        handle = self._wait(self._arm.send_goal_async(goal), PATIENCE_S)
        self._noted.answers_s.append(time.perf_counter() - sent_s)
        self._noted.goals += 1
        result = handle.get_result_async()
        if cancel_after_s is not None:
            self.spin(cancel_after_s)
            canceled_s = time.perf_counter()
            self._wait(handle.cancel_goal_async(), PATIENCE_S)
            self._noted.cancels_s.append(time.perf_counter() - canceled_s)
        wanted = 0 if handle.accepted else -1
        self._noted.failed += self._wait(result, PATIENCE_S + seconds).result.error_code != wanted
        self._waiting_since_s = None

    def _wait(self, future: Future, patience_s: float) -> Any:
        self._until(future.done, patience_s, f"the stack did not respond within {patience_s:.0f} s: check its log")
        return future.result()

    def _until(self, done: Callable[[], bool], patience_s: float, late: str) -> None:
        """Spin until ``done`` returns True. Raises DriverError, after a timeout with the message ``late``."""
        end_s = time.perf_counter() + patience_s
        while not done():
            if self._stop():
                raise DriverError("the measurement was stopped")
            if time.perf_counter() > end_s:
                raise DriverError(late)
            self._executor.spin_once(timeout_sec=POLL_S)

    def _on_state(self, message: JointState) -> None:
        if self.recording:
            stamp_s = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
            self._noted.stamps_s.append(stamp_s)
            self._noted.ages_s.append(self._now() - stamp_s)
        self._position = list(message.position)
        moved = any(abs(a - b) > self._controller.moved for a, b in zip(self._start, self._position, strict=False))
        if moved and self._waiting_since_s is not None:
            self._noted.motions_s.append(time.perf_counter() - self._waiting_since_s)
            self._waiting_since_s = None


def goal_to(joints: Sequence[str], position: Sequence[float], seconds: float) -> FollowJointTrajectory.Goal:
    """Build a goal with a single point (in rad or m), like the goals that most clients send."""
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = list(joints)
    point = JointTrajectoryPoint(positions=list(position))
    point.time_from_start.sec, point.time_from_start.nanosec = int(seconds), int(seconds % 1.0 * 1e9)
    goal.trajectory.points = [point]
    return goal
