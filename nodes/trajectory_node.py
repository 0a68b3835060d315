"""The joint trajectory controller's face: ``~/follow_joint_trajectory``, and what trajectory_topics.py adds."""

from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from controller.goal import GoalHandle, TrajectoryGoal
from controller.joint_trajectory_controller import JointTrajectoryController
from controller.tracking import Tracking
from hal.types import JointState
from nodes.conversions import kinematics_message, point_message, seconds, trajectory_goal
from nodes.goals import RESULT_TIMEOUT_S, Goals
from nodes.pace import Pace
from nodes.trajectory_topics import TrajectoryTopics, error_message


class TrajectoryNode:
    """On the node of its controller: a state and feedback for each cycle, and results behind them."""

    def __init__(self, node: Node, controller: JointTrajectoryController) -> None:
        self.node = node
        self._controller = controller
        self._topics = TrajectoryTopics(node, controller)
        self._offered: tuple[FollowJointTrajectory.Goal, TrajectoryGoal] | None = None
        self._goals: Goals[GoalHandle] = Goals(controller.cancel, _result)
        self._pace = Pace()
        self._server = ActionServer(
            self.node,
            FollowJointTrajectory,
            "~/follow_joint_trajectory",
            execute_callback=self._goals.execute,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._goals.on_cancel,
            result_timeout=RESULT_TIMEOUT_S,
        )

    def show(self, state: JointState, stamp: Time) -> None:
        """One cycle, and feedback of the goals under way where it is due."""
        for tracking in self._controller.tracked(state.stamp_s):
            self._topics.show(tracking, stamp)
            if self._goals.any and self._pace.due(state.stamp_s, self._controller.parameters.action_monitor_rate):
                self._goals.tell(self._feedback(tracking, stamp))
        if self._controller.tracking is None:
            self._topics.forget()

    def publish(self, stamp: Time) -> None:
        """The end of the goals that are decided: after the states of all cycles."""
        self._goals.settle()

    def _on_goal(self, request: FollowJointTrajectory.Goal) -> GoalResponse:
        goal = self._read(request)
        reason = self._controller.check(goal)
        if reason:
            self._topics.refuse(f"goal rejected: {reason}")
            return GoalResponse.REJECT
        self._offered = request, goal
        return GoalResponse.ACCEPT

    def _on_accepted(self, server_goal: ServerGoalHandle) -> None:
        self._goals.accept(server_goal, self._controller.submit(self._taken(server_goal.request)))

    def _taken(self, request: FollowJointTrajectory.Goal) -> TrajectoryGoal:
        """The goal as it was checked, with its plan."""
        offered, self._offered = self._offered, None
        if offered is not None and offered[0] is request:
            return offered[1]
        return self._read(request)

    def _read(self, request: FollowJointTrajectory.Goal) -> TrajectoryGoal:
        now_s = seconds(self.node.get_clock().now().to_msg())
        return self._topics.timed(trajectory_goal(request, now_s), now_s)

    def _feedback(self, tracking: Tracking, stamp: Time) -> FollowJointTrajectory.Feedback:
        feedback = FollowJointTrajectory.Feedback()
        feedback.header.stamp = stamp
        feedback.joint_names = list(self._controller.joints)
        feedback.desired = kinematics_message(tracking.reference)
        feedback.actual = point_message(tracking.feedback_position, tracking.feedback_velocity)
        feedback.error = error_message(tracking)
        return feedback


def _result(handle: GoalHandle) -> FollowJointTrajectory.Result:
    return FollowJointTrajectory.Result(error_code=handle.error_code, error_string=handle.error_text)
