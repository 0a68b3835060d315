"""A client of a running stack that notes how prompt it is: answers, first motions, age and stamps of /joint_states."""

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

from drivers.errors import DriverError

PATIENCE_S: Final = 30.0
LOOK_S: Final = 0.05
"""So often a wait is asked whether it is to end."""


@dataclass(slots=True)
class Promptness:
    """All that was noted, s."""

    answers_s: list[float] = field(default_factory=list)
    cancels_s: list[float] = field(default_factory=list)
    motions_s: list[float] = field(default_factory=list)
    stamps_s: list[float] = field(default_factory=list)
    """Of /joint_states, ROS time, while ``recording``."""
    ages_s: list[float] = field(default_factory=list)
    """From each of these stamps to the client."""
    goals: int = 0
    failed: int = 0


class TimingClient:
    """Sends goals to a joint trajectory controller, one at a time. The caller's thread spins ``executor``."""

    def __init__(
        self,
        node: Node,
        executor: SingleThreadedExecutor,
        joints: Sequence[str],
        noted: Promptness,
        controller: str = "arm_controller",
        moved: float = 1e-6,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """``moved``: a joint that is measured so far (rad or m) elsewhere has moved; ``stop`` ends every wait.

        Raises DriverError where nobody offers the controller's action.
        """
        self.recording = False
        self._executor, self._joints, self._noted, self._moved, self._stop = executor, joints, noted, moved, stop
        self._now: Callable[[], float] = lambda: node.get_clock().now().nanoseconds * 1e-9
        self._arm = ActionClient(node, FollowJointTrajectory, f"/{controller}/follow_joint_trajectory")
        self._position: list[float] = []
        self._waiting_since_s: float | None = None
        self._start: list[float] = []
        node.create_subscription(JointState, "/joint_states", self._on_state, 100)
        if not self._arm.wait_for_server(PATIENCE_S):
            raise DriverError(f"nobody offers /{controller}/follow_joint_trajectory")

    def spin(self, seconds: float) -> None:
        """Serve callbacks for so long."""
        end_s = time.perf_counter() + seconds
        while (left_s := end_s - time.perf_counter()) > 0.0 and not self._stop():
            self._executor.spin_once(timeout_sec=min(left_s, LOOK_S))

    def go(
        self, position: Sequence[float], seconds: float, cancel_after_s: float | None = None, period_s: float = 0.05
    ) -> None:
        """Send one goal and wait for its end; it is cancelled on its way where ``cancel_after_s`` says so.

        It is sent at any point of the stack's cycle of ``period_s``. Raises DriverError where nobody answers.
        """
        goal = goal_to(self._joints, position, seconds)
        self.spin(random.uniform(0.0, period_s))
        sent_s = self._waiting_since_s = time.perf_counter()
        self._start = self._position
        handle = self._wait(self._arm.send_goal_async(goal), PATIENCE_S)
        self._noted.answers_s.append(time.perf_counter() - sent_s)
        self._noted.goals += 1
        result = handle.get_result_async()
        if cancel_after_s is not None:
            self.spin(cancel_after_s)
            asked_s = time.perf_counter()
            self._wait(handle.cancel_goal_async(), PATIENCE_S)
            self._noted.cancels_s.append(time.perf_counter() - asked_s)
        wanted = 0 if handle.accepted else -1
        self._noted.failed += self._wait(result, PATIENCE_S + seconds).result.error_code != wanted
        self._waiting_since_s = None

    def _wait(self, future: Future, patience_s: float) -> Any:
        end_s = time.perf_counter() + patience_s
        while not future.done():
            if self._stop():
                raise DriverError("stopped")
            if time.perf_counter() > end_s:
                raise DriverError(f"the stack did not answer within {patience_s:.0f} s")
            self._executor.spin_once(timeout_sec=LOOK_S)
        return future.result()

    def _on_state(self, message: JointState) -> None:
        if self.recording:
            stamp_s = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
            self._noted.stamps_s.append(stamp_s)
            self._noted.ages_s.append(self._now() - stamp_s)
        self._position = list(message.position)
        moved = any(abs(a - b) > self._moved for a, b in zip(self._start, self._position, strict=False))
        if moved and self._waiting_since_s is not None:
            self._noted.motions_s.append(time.perf_counter() - self._waiting_since_s)
            self._waiting_since_s = None


def goal_to(joints: Sequence[str], position: Sequence[float], seconds: float) -> FollowJointTrajectory.Goal:
    """A goal of one point (rad or m), as most clients send it."""
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = list(joints)
    point = JointTrajectoryPoint(positions=list(position))
    point.time_from_start.sec, point.time_from_start.nanosec = int(seconds), int(seconds % 1.0 * 1e9)
    goal.trajectory.points = [point]
    return goal
