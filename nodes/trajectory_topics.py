"""Topics and services of a joint trajectory controller beside its action."""

from dataclasses import replace

from builtin_interfaces.msg import Time
from control_msgs.msg import JointTrajectoryControllerState, SpeedScalingFactor
from control_msgs.srv import QueryTrajectoryState
from rclpy.node import Node
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from controller.goal import TrajectoryGoal
from controller.joint_trajectory_controller import JointTrajectoryController
from controller.tracking import Tracking
from nodes.conversions import kinematics_message, point_message, seconds, trajectory_of
from nodes.qos import ANY_CLIENT, LATCHED, LATCHED_WHILE_NEW


class TrajectoryTopics:
    """Upstream's ``~/joint_trajectory``, ``~/speed_scaling_input``, ``~/controller_state`` and ``~/query_state``,
    and our ``~/rejection_reason``: why the last goal or trajectory was refused, for those who come later too."""

    def __init__(self, node: Node, controller: JointTrajectoryController) -> None:
        self._node = node
        self._controller = controller
        self._seen: tuple[Tracking, float] | None = None
        """The newest cycle and its ROS time in seconds."""
        self._state = node.create_publisher(JointTrajectoryControllerState, "~/controller_state", LATCHED_WHILE_NEW)
        self._reason = node.create_publisher(String, "~/rejection_reason", LATCHED)
        node.create_subscription(JointTrajectory, "~/joint_trajectory", self._on_trajectory, ANY_CLIENT)
        node.create_subscription(SpeedScalingFactor, "~/speed_scaling_input", self._on_scaling, ANY_CLIENT)
        node.create_service(QueryTrajectoryState, "~/query_state", self._on_query)

    def show(self, tracking: Tracking, stamp: Time) -> None:
        """One cycle."""
        self._seen = tracking, seconds(stamp)
        if self._state.get_subscription_count():
            self._state.publish(self._state_message(tracking, stamp))

    def forget(self) -> None:
        """The controller is inactive: nothing is tracked now."""
        self._seen = None

    def refuse(self, reason: str) -> None:
        """Say why something is not executed, in the log and on the topic."""
        self._node.get_logger().error(reason)
        self._reason.publish(String(data=reason))

    def timed(self, goal: TrajectoryGoal, now_s: float) -> TrajectoryGoal:
        """With the time of the next cycle, by the newest one; ``now_s`` is the ROS time at which it was read."""
        if self._seen is None:
            return goal
        tracking, stamp_s = self._seen
        ahead_s = max(stamp_s + self._controller.period_s - now_s, 0.0)
        return replace(goal, next_cycle_s=ahead_s, begins_s=tracking.stamp_s + now_s - stamp_s + ahead_s)

    def _on_trajectory(self, message: JointTrajectory) -> None:
        now_s = seconds(self._node.get_clock().now().to_msg())
        goal = self.timed(trajectory_of(message, now_s, from_topic=True), now_s)
        if reason := self._controller.check(goal):
            self.refuse(f"trajectory on the topic ignored: {reason}")
        else:
            self._controller.submit(goal)

    def _on_scaling(self, message: SpeedScalingFactor) -> None:
        if reason := self._controller.scaling.ask(message.factor):
            self._node.get_logger().warning(reason)

    def _on_query(
        self, request: QueryTrajectoryState.Request, response: QueryTrajectoryState.Response
    ) -> QueryTrajectoryState.Response:
        """Where the joints are to be at a time, by the trajectory and the speed scaling of now."""
        if self._seen is None:
            response.message = "Can't sample trajectory. Controller is not active."
            return response
        tracking, stamp_s = self._seen
        state, response.success = tracking.at(seconds(request.time) - stamp_s)
        response.message = "" if response.success else "No trajectory is under way at that time."
        response.name = list(self._controller.joints)
        response.position, response.velocity = state.position.tolist(), state.velocity.tolist()
        response.acceleration = state.acceleration.tolist()
        return response

    def _state_message(self, tracking: Tracking, stamp: Time) -> JointTrajectoryControllerState:
        message = JointTrajectoryControllerState()
        message.header.stamp = stamp
        message.joint_names = list(self._controller.joints)
        message.reference = kinematics_message(tracking.reference)
        message.feedback = point_message(tracking.feedback_position, tracking.feedback_velocity)
        message.error = error_message(tracking)
        message.output = point_message(tracking.output)
        message.speed_scaling_factor = tracking.speed_scaling_factor
        return message


def error_message(tracking: Tracking) -> JointTrajectoryPoint:
    """Desired less actual."""
    return point_message(tracking.error, tracking.reference.velocity - tracking.feedback_velocity)
