"""Serve the action ``~/gripper_cmd`` of the gripper controllers, using either of ros2_control's two action types."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from builtin_interfaces.msg import Time
from control_msgs.action import GripperCommand, ParallelGripperCommand
from rclpy.action import GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from sensor_msgs.msg import JointState

from controller.gripper.goal import GripperGoal, GripperHandle, GripperState
from controller.gripper.gripper_action_controller import GripperActionController
from drivers.printable import printable
from nodes.controllers.action_goals import ActionGoals, make_action_server
from nodes.publishing import RateLimiter


class GripperNode(ABC):
    """Interface node of a gripper controller. ``publish`` is called after each cycle."""

    action: ClassVar[Any]

    def __init__(self, node: Node, controller: GripperActionController) -> None:
        self.node = node
        self._controller = controller
        self._goals: ActionGoals[GripperHandle] = ActionGoals(controller.cancel, self._result)
        self._rate_limiter = RateLimiter()
        self._server = make_action_server(
            node, self.action, "~/gripper_cmd", self._goals, self._on_goal, self._on_accepted
        )

    @abstractmethod
    def goal(self, request: Any) -> GripperGoal:
        """Convert a request to a goal.

        Raises:
            ValueError: The request is invalid.
        """

    @abstractmethod
    def result(self, state: GripperState, stamp: Time) -> Any:
        """Create the result of the action."""

    @abstractmethod
    def feedback(self, state: GripperState, stamp: Time) -> Any:
        """Create the feedback of the action."""

    @property
    def joint(self) -> str:
        """Name of the gripper joint."""
        return self._controller.joint

    def publish(self, stamp: Time) -> None:
        """Publish feedback for the running goal, and send the results of finished goals."""
        if not self._goals.waiting:
            return
        due = self._rate_limiter.due(stamp.sec + stamp.nanosec * 1e-9, self._controller.parameters.action_monitor_rate)
        state = self._controller.state
        if due and state is not None:
            self._goals.publish_feedback(self.feedback(state, stamp))
        self._goals.finish_decided()

    def _on_goal(self, request: Any) -> GoalResponse:
        try:
            reason = self._controller.check(self.goal(request))
        except ValueError as error:
            reason = str(error)
        if reason:
            self.node.get_logger().error(printable(f"goal rejected: {reason}"))
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_accepted(self, server_goal: ServerGoalHandle) -> None:
        goal = self.goal(server_goal.request)
        if goal.max_effort:
            text = f"max effort {goal.max_effort:g} is ignored: torque_limit in the robot file limits the force"
            self.node.get_logger().warning(text, once=True)
        self._goals.accept(server_goal, self._controller.submit(goal))

    def _result(self, handle: GripperHandle) -> Any:
        self.node.get_logger().info(printable(f"goal {handle.status.value}: {handle.text}"))
        return self.result(handle.state, self.node.get_clock().now().to_msg())


class ParallelGripperNode(GripperNode):
    """Interface node for the action type control_msgs/action/ParallelGripperCommand."""

    action = ParallelGripperCommand

    def goal(self, request: ParallelGripperCommand.Goal) -> GripperGoal:
        command = request.command
        names, count = list(command.name), len(command.position)
        if count != 1:
            raise ValueError(f"Received action goal with wrong number of position values, expects 1, got {count}")
        if names not in ([], [self.joint]):
            raise ValueError(f"the goal is for {', '.join(names)}, but the joint of this gripper is {self.joint}")
        return GripperGoal(command.position[0], _only(command.velocity), _only(command.effort))

    def result(self, state: GripperState, stamp: Time) -> ParallelGripperCommand.Result:
        return ParallelGripperCommand.Result(
            state=self._joint_state(state, stamp), stalled=state.stalled, reached_goal=state.reached_goal
        )

    def feedback(self, state: GripperState, stamp: Time) -> ParallelGripperCommand.Feedback:
        return ParallelGripperCommand.Feedback(state=self._joint_state(state, stamp))

    def _joint_state(self, state: GripperState, stamp: Time) -> JointState:
        message = JointState(
            name=[self.joint], position=[state.position], velocity=[state.velocity], effort=[state.effort]
        )
        message.header.stamp = stamp
        return message


class PositionGripperNode(GripperNode):
    """Interface node for the action type control_msgs/action/GripperCommand."""

    action = GripperCommand

    def goal(self, request: GripperCommand.Goal) -> GripperGoal:
        return GripperGoal(request.command.position, max_effort=request.command.max_effort)

    def result(self, state: GripperState, stamp: Time) -> GripperCommand.Result:
        return GripperCommand.Result(**self._fields(state))

    def feedback(self, state: GripperState, stamp: Time) -> GripperCommand.Feedback:
        return GripperCommand.Feedback(**self._fields(state))

    def _fields(self, state: GripperState) -> dict[str, Any]:
        return {
            "position": state.position,
            "effort": state.effort,
            "stalled": state.stalled,
            "reached_goal": state.reached_goal,
        }


def _only(values: Any) -> float:
    """Return the value of an optional single-value field, or 0 if the field is empty."""
    if len(values) > 1:
        raise ValueError(f"the goal has {len(values)} values for velocity or effort: send at most one value for each")
    return float(values[0]) if len(values) else 0.0
