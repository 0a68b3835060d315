"""Publish states and feedback of the joint trajectory controller. The controller's goals are handled in
trajectory_goals.py."""

from typing import Final

import numpy as np
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState, SpeedScalingFactor
from control_msgs.srv import QueryTrajectoryState
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectoryPoint

from controller.motion import Kinematics
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import Tracking
from drivers.printable import printable
from hal.types import FloatArray, JointState
from nodes.controllers.trajectory_goals import TrajectoryGoals
from nodes.publishing import ANY_CLIENT, LATCHED_WHILE_NEW, RateLimiter, numbers

NOTHING: Final = np.empty(0)
"""Value for a field that is empty in a message."""


class TrajectoryNode:
    """Interface node of a joint trajectory controller. The node publishes a state and feedback for each cycle.

    In addition to handling goals, the node provides ``~/controller_state``, ``~/speed_scaling_input`` and
    ``~/query_state``, as in ros2_control.
    """

    def __init__(self, node: Node, controller: JointTrajectoryController) -> None:
        self.node = node
        self._controller = controller
        self._goals = TrajectoryGoals(node, controller)
        self._rate_limiter = RateLimiter()
        self._message = JointTrajectoryControllerState(joint_names=list(controller.joints))
        self._state = node.create_publisher(JointTrajectoryControllerState, "~/controller_state", LATCHED_WHILE_NEW)
        node.create_subscription(SpeedScalingFactor, "~/speed_scaling_input", self._on_scaling, ANY_CLIENT)
        node.create_service(QueryTrajectoryState, "~/query_state", self._on_query)

    def publish_cycle(self, state: JointState, stamp: Time) -> None:
        """Publish the state of one cycle and, if it is due, the feedback for the running goals."""
        rate_hz = self._controller.parameters.action_monitor_rate
        for tracking in self._controller.tracked(state.stamp_s):
            self._goals.newest = tracking, stamp.sec + stamp.nanosec * 1e-9
            if self._state.get_subscription_count():
                self._state.publish(self._state_message(tracking, stamp))
            if self._goals.under_way.waiting and self._rate_limiter.due(state.stamp_s, rate_hz):
                self._goals.under_way.publish_feedback(self._feedback(tracking, stamp))
        if self._controller.tracking is None:
            self._goals.newest = None

    def publish(self, stamp: Time) -> None:
        """Send the results of finished goals once the states of all cycles have been published."""
        self._goals.under_way.finish_decided()

    def _on_scaling(self, message: SpeedScalingFactor) -> None:
        if reason := self._controller.scaling.ask(message.factor):
            self.node.get_logger().warning(printable(reason))

    def _on_query(
        self, request: QueryTrajectoryState.Request, response: QueryTrajectoryState.Response
    ) -> QueryTrajectoryState.Response:
        """Sample the trajectory at the requested time, with the current speed scaling."""
        if self._goals.newest is None:
            response.message = "Can't sample trajectory. Controller is not active."
            return response
        tracking, stamp_s = self._goals.newest
        state, response.success = tracking.at(request.time.sec + request.time.nanosec * 1e-9 - stamp_s)
        response.message = "" if response.success else "No trajectory is active at that time."
        response.name = list(self._controller.joints)
        response.position, response.velocity = state.position.tolist(), state.velocity.tolist()
        response.acceleration = state.acceleration.tolist()
        return response

    def _state_message(self, tracking: Tracking, stamp: Time) -> JointTrajectoryControllerState:
        """Fill in the message, which is reused, because publishing serializes it immediately."""
        message = self._message
        message.header.stamp = stamp
        _fill_kinematics(message.reference, tracking.reference)
        _fill(message.feedback, tracking.feedback_position, tracking.feedback_velocity)
        _fill_error(message.error, tracking)
        _fill(message.output, tracking.output)
        message.speed_scaling_factor = tracking.speed_scaling_factor
        return message

    def _feedback(self, tracking: Tracking, stamp: Time) -> FollowJointTrajectory.Feedback:
        feedback = FollowJointTrajectory.Feedback()
        feedback.header.stamp = stamp
        feedback.joint_names = list(self._controller.joints)
        _fill_kinematics(feedback.desired, tracking.reference)
        _fill(feedback.actual, tracking.feedback_position, tracking.feedback_velocity)
        _fill_error(feedback.error, tracking)
        return feedback


def _fill_error(point: JointTrajectoryPoint, tracking: Tracking) -> None:
    """Fill in the desired state minus the actual state."""
    _fill(point, tracking.error, tracking.reference.velocity - tracking.feedback_velocity)


def _fill_kinematics(point: JointTrajectoryPoint, state: Kinematics) -> None:
    _fill(point, state.position, state.velocity, state.acceleration)


def _fill(
    point: JointTrajectoryPoint,
    position: FloatArray,
    velocity: FloatArray = NOTHING,
    acceleration: FloatArray = NOTHING,
) -> None:
    """Fill in a trajectory point from arrays of shape (n,) or empty arrays."""
    point.positions, point.velocities = numbers(position), numbers(velocity)
    point.accelerations = numbers(acceleration)
