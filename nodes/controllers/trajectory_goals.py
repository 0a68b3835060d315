"""Receive the goals of a joint trajectory controller from its action and its topic."""

from dataclasses import replace
from functools import partial

from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from rclpy.action import GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import Tracking
from controller.trajectory.tolerances import ERASE, Tolerances
from drivers.printable import printable
from nodes.controllers.action_goals import ActionGoals, make_action_server
from nodes.publishing import ANY_CLIENT, LATCHED
from nodes.rclpy_patches.client_limits import CLIENT_LIMITS

NO_TOLERANCES = Tolerances()
ACTION = "~/follow_joint_trajectory"
IGNORED = "trajectory on the topic ignored"


class TrajectoryGoals:
    """Action ``~/follow_joint_trajectory`` and topic ``~/joint_trajectory``, as in ros2_control.

    The additional topic ``~/rejection_reason`` is latched. The topic explains why the last goal or trajectory was
    rejected.
    """

    def __init__(self, node: Node, controller: JointTrajectoryController) -> None:
        self._node = node
        self._clock = node.get_clock()
        self._controller = controller
        self.newest: tuple[Tracking, float] | None = None
        """Latest cycle and its ROS time in seconds, or None while the controller is inactive."""
        self._checked_goal: tuple[FollowJointTrajectory.Goal, TrajectoryGoal] | None = None
        self.under_way: ActionGoals[GoalHandle] = ActionGoals(controller.cancel, _result)
        self._reason = node.create_publisher(String, "~/rejection_reason", LATCHED)
        for name, what in ((ACTION, "goal rejected"), ("~/joint_trajectory", IGNORED)):
            CLIENT_LIMITS.on_refused[node.resolve_topic_name(name)] = partial(_publish_reason, self._reason, what)
        node.create_subscription(JointTrajectory, "~/joint_trajectory", self._on_trajectory, ANY_CLIENT)
        kind, goals = FollowJointTrajectory, self.under_way
        self._server = make_action_server(node, kind, ACTION, goals, self._on_goal, self._on_accepted)

    def _on_goal(self, request: FollowJointTrajectory.Goal) -> GoalResponse:
        goal = self._goal_of(request)
        reason = self._controller.check(goal)
        if reason:
            self._refuse(f"goal rejected: {reason}")
            return GoalResponse.REJECT
        self._checked_goal = request, goal
        return GoalResponse.ACCEPT

    def _on_accepted(self, server_goal: ServerGoalHandle) -> None:
        self.under_way.accept(server_goal, self._controller.submit(self._checked(server_goal.request)))

    def _checked(self, request: FollowJointTrajectory.Goal) -> TrajectoryGoal:
        """Return the goal that was checked for this request, including its plan."""
        checked, self._checked_goal = self._checked_goal, None
        if checked is not None and checked[0] is request:
            return checked[1]
        return self._goal_of(request)

    def _on_trajectory(self, message: JointTrajectory) -> None:
        goal = self._timed(message, NO_TOLERANCES, from_topic=True)
        if reason := self._controller.check(goal):
            self._refuse(f"{IGNORED}: {reason}")
        else:
            self._controller.submit(goal)

    def _refuse(self, reason: str) -> None:
        """Log and publish the reason why a message was rejected."""
        self._node.get_logger().error(printable(reason))
        self._reason.publish(String(data=reason))

    def _goal_of(self, request: FollowJointTrajectory.Goal) -> TrajectoryGoal:
        tolerances = Tolerances(
            path={t.name: _tolerance(t) for t in request.path_tolerance},
            goal={t.name: _tolerance(t) for t in request.goal_tolerance},
            goal_time_s=_seconds(request.goal_time_tolerance),
        )
        return self._timed(request.trajectory, tolerances)

    def _timed(self, message: JointTrajectory, tolerances: Tolerances, from_topic: bool = False) -> TrajectoryGoal:
        """Convert a trajectory and add the time of the next cycle, estimated from that of the latest cycle."""
        now_s = self._clock.now().nanoseconds * 1e-9
        goal = _trajectory(message, now_s, tolerances, from_topic)
        if self.newest is None:
            return goal
        tracking, stamp_s = self.newest
        ahead_s = max(stamp_s + self._controller.period_s - now_s, 0.0)
        return replace(goal, next_cycle_s=ahead_s, begins_s=tracking.stamp_s + now_s - stamp_s + ahead_s)


def _trajectory(message: JointTrajectory, now_s: float, tolerances: Tolerances, from_topic: bool) -> TrajectoryGoal:
    """Convert a trajectory. The stamp of the trajectory is compared with ``now_s``, the current ROS time."""
    stamp_s = _seconds(message.header.stamp)
    points = tuple(
        GoalPoint(
            tuple(point.positions),
            _seconds(point.time_from_start),
            tuple(point.velocities),
            tuple(point.accelerations),
            has_effort=bool(point.effort),
        )
        for point in message.points
    )
    delay_s = stamp_s - now_s if stamp_s else 0.0
    return TrajectoryGoal(tuple(message.joint_names), points, tolerances, delay_s, from_topic)


def _tolerance(message: JointTolerance) -> float:
    """Return the position tolerance.

    Velocity and acceleration tolerances do not affect position commands. As in ros2_control, however, an invalid
    velocity or acceleration tolerance makes the whole tolerance invalid.
    """
    others = (message.velocity, message.acceleration)
    return next((float(other) for other in others if other < 0.0 and other != ERASE), float(message.position))


def _seconds(stamp: Duration | Time) -> float:
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def _publish_reason(topic: Publisher, what: str, reason: str) -> None:
    """Publish why a message was rejected. This is a function, because a bound method stored in ``CLIENT_LIMITS`` would
    prevent the node from being freed."""
    topic.publish(String(data=f"{what}: {reason}"))


def _result(handle: GoalHandle) -> FollowJointTrajectory.Result:
    return FollowJointTrajectory.Result(error_code=handle.error_code, error_string=handle.error_text)
