"""The joint trajectory controller's face: ``~/follow_joint_trajectory`` and ``~/controller_state``."""

from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from controller.goal import GoalHandle, GoalStatus
from controller.joint_trajectory_controller import JointTrajectoryController, Tracking
from nodes.conversions import kinematics_message, point_message, seconds, trajectory_goal


class TrajectoryNode:
    """One node named after its controller. ``publish`` runs after each cycle."""

    def __init__(self, controller: JointTrajectoryController) -> None:
        self.node = Node(controller.name)
        self._controller = controller
        self._goals: dict[bytes, GoalHandle] = {}
        self._waiting: dict[bytes, tuple[ServerGoalHandle, Future]] = {}
        self._state = self.node.create_publisher(JointTrajectoryControllerState, "~/controller_state", 10)
        self._server = ActionServer(
            self.node,
            FollowJointTrajectory,
            "~/follow_joint_trajectory",
            execute_callback=self._execute,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )

    def publish(self, stamp: Time) -> None:
        """State, feedback of the goals under way, and the end of those that are decided."""
        tracking = self._controller.tracking
        if tracking is not None:
            self._state.publish(self._state_message(tracking, stamp))
        for key, (server_goal, future) in list(self._waiting.items()):
            if self._goals[key].done:
                future.set_result(None)
                del self._waiting[key]
            elif tracking is not None:
                server_goal.publish_feedback(self._feedback(tracking, stamp))

    def _now_s(self) -> float:
        return seconds(self.node.get_clock().now().to_msg())

    def _on_goal(self, request: FollowJointTrajectory.Goal) -> GoalResponse:
        reason = self._controller.check(trajectory_goal(request, self._now_s()))
        if reason:
            self.node.get_logger().error(f"goal rejected: {reason}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_accepted(self, server_goal: ServerGoalHandle) -> None:
        # Handed over here and not in _execute, which runs only when the executor comes round again.
        goal = trajectory_goal(server_goal.request, self._now_s())
        self._goals[bytes(server_goal.goal_id.uuid)] = self._controller.submit(goal)
        server_goal.execute()

    def _on_cancel(self, server_goal: ServerGoalHandle) -> CancelResponse:
        handle = self._goals.get(bytes(server_goal.goal_id.uuid))
        if handle is None or handle.done:
            return CancelResponse.REJECT
        self._controller.cancel(handle)
        return CancelResponse.ACCEPT

    async def _execute(self, server_goal: ServerGoalHandle) -> FollowJointTrajectory.Result:
        key = bytes(server_goal.goal_id.uuid)
        future: Future = Future()
        self._waiting[key] = (server_goal, future)
        await future
        return self._finish(server_goal, self._goals.pop(key))

    def _finish(self, server_goal: ServerGoalHandle, handle: GoalHandle) -> FollowJointTrajectory.Result:
        # A goal that reaches its end in the instant in which its cancel is accepted is canceling
        # for the action server, which then allows no success.
        if handle.status is GoalStatus.CANCELED and server_goal.is_cancel_requested:
            server_goal.canceled()
        elif handle.status is GoalStatus.SUCCEEDED:
            server_goal.succeed()
        else:
            server_goal.abort()
        return FollowJointTrajectory.Result(error_code=handle.error_code, error_string=handle.error_text)

    def _feedback(self, tracking: Tracking, stamp: Time) -> FollowJointTrajectory.Feedback:
        feedback = FollowJointTrajectory.Feedback()
        feedback.header.stamp = stamp
        feedback.joint_names = list(self._controller.joints)
        feedback.desired = kinematics_message(tracking.reference)
        feedback.actual = point_message(tracking.feedback_position, tracking.feedback_velocity)
        feedback.error = _error(tracking)
        return feedback

    def _state_message(self, tracking: Tracking, stamp: Time) -> JointTrajectoryControllerState:
        message = JointTrajectoryControllerState()
        message.header.stamp = stamp
        message.joint_names = list(self._controller.joints)
        message.reference = kinematics_message(tracking.reference)
        message.feedback = point_message(tracking.feedback_position, tracking.feedback_velocity)
        message.error = _error(tracking)
        message.output = point_message(tracking.output)
        message.speed_scaling_factor = 1.0
        return message


def _error(tracking: Tracking) -> object:
    return point_message(
        tracking.reference.position - tracking.feedback_position,
        tracking.reference.velocity - tracking.feedback_velocity,
    )
