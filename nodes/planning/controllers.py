"""Controllers of the running stack that execute trajectories: arm, gripper and forward command controllers."""

from collections.abc import Callable
from typing import Any, Final, Protocol

from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory, GripperCommand, ParallelGripperCommand
from rclpy.action import ActionClient
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from nodes.pick_place.waiter import Waiter
from nodes.planning.conversion.trajectories import seconds_of
from nodes.planning.joint_monitor import JointMonitor
from nodes.planning.request_errors import RequestError
from nodes.planning.routes import Route

ANSWER_S: Final = 3.0
"""Maximum time for a controller to accept a goal, in seconds."""
CANCEL_S: Final = 10.0
"""Maximum time for a controller to stop after a goal is canceled, in seconds."""
SLACK: Final = 2.0
"""Factor in the time limit of a trajectory, which is ``SLACK`` times the duration plus ``SLACK_S``."""
SLACK_S: Final = 10.0
"""Time added to the limit, in seconds. A controller that exceeds the limit is considered stuck."""
REST_S: Final = 0.4
"""Time without motion after which the joints of a forward controller are considered at rest, in seconds."""
CLOSE: Final = 2e-3
"""Maximum distance from the commanded position at which a joint is considered to have arrived, in rad or m."""
STILL: Final = 5e-4
"""Maximum motion between two checks at which a joint is considered at rest, in rad or m."""
POLL_S: Final = 0.05
"""Period of the checks for arrival and rest, in seconds."""

_ENDS: Final = {
    GoalStatus.STATUS_CANCELED: "its goal was canceled by another client, such as servoloop stop: send it again",
    GoalStatus.STATUS_ABORTED: "its goal was aborted, for example by servoloop stop: check the log of the stack",
}
"""Descriptions of a goal that ended without an error text, keyed by status."""


class StopRequest:
    """A request to stop a motion, with a MoveIt error code and a message for the client."""

    def __init__(self) -> None:
        self.future = Future()
        self.code = ""
        self.message = ""

    @property
    def requested(self) -> bool:
        """Whether the motion must stop."""
        return bool(self.future.done())

    def request(self, code: str, message: str) -> None:
        """Stop the motion. Only the first reason is kept."""
        if not self.requested:
            self.code, self.message = code, message
            self.future.set_result(None)

    def check(self) -> None:
        """Raise RequestError if the motion must stop."""
        if self.requested:
            raise RequestError(self.code, self.message)


class RouteController(Protocol):
    """Controller that executes trajectories of its joints."""

    route: Route

    async def follow(self, trajectory: JointTrajectory, stop: StopRequest) -> str:
        """Follow a trajectory until it ends or a stop is requested. Return the reason if the trajectory was not
        executed, otherwise "". If a stop is already requested, send nothing."""
        ...


def controllers(node: Node, routes: tuple[Route, ...], joints: JointMonitor) -> dict[str, RouteController]:
    """Return the controllers of the stack, keyed by name."""
    makers: dict[str, Callable[[Route], RouteController]] = {
        "trajectory": lambda route: ActionController(node, route, FollowJointTrajectory, "follow_joint_trajectory"),
        "gripper": lambda route: ActionController(node, route, GripperCommand, "gripper_cmd"),
        "parallel_gripper": lambda route: ActionController(node, route, ParallelGripperCommand, "gripper_cmd"),
        "forward": lambda route: ForwardController(node, route, joints),
    }
    return {route.name: makers[route.kind](route) for route in routes}


class ActionController:
    """Controller with an action server: a trajectory controller or a gripper controller."""

    def __init__(self, node: Node, route: Route, action: Any, suffix: str) -> None:
        self.route = route
        self._action = action
        self._waiter = Waiter(node)
        self._name = node.resolve_service_name(f"{route.name}/{suffix}")
        self._client = ActionClient(node, action, self._name, callback_group=ReentrantCallbackGroup())

    async def follow(self, trajectory: JointTrajectory, stop: StopRequest) -> str:
        """Send one goal and wait for its result. A request to stop cancels the goal, and the controller brakes along
        the path."""
        is_ready = await self._waiter.until_ready(ANSWER_S, self._client.server_is_ready, stop.future)
        if stop.requested:
            return ""
        if not is_ready:
            return f"the action {self._name} is not available: start the stack, and activate {self.route.name}"
        sent = self._client.send_goal_async(self._goal(trajectory))
        if not await self._waiter.until(ANSWER_S, sent):
            sent.add_done_callback(_cancel_if_accepted)
            return f"{self.route.name} did not respond within {ANSWER_S:g} s: check the log of the stack"
        handle = sent.result()
        if not handle.accepted:
            return f"{self.route.name} rejected the trajectory: the log of the stack contains the reason"
        return await self._result(handle, seconds_of(trajectory.points[-1].time_from_start), stop)

    async def _result(self, handle: Any, duration_s: float, stop: StopRequest) -> str:
        result, ready = handle.get_result_async(), self._client.server_is_ready
        limit_s = duration_s * SLACK + SLACK_S
        await self._waiter.until_moved(limit_s, ready, result, stop.future)
        if not result.done():
            handle.cancel_goal_async()
            if not await self._waiter.until_moved(CANCEL_S, ready, result):
                return f"{self.route.name} did not confirm that it stopped: check the log of the stack"
            if not stop.requested:
                return f"{self.route.name} did not finish within {limit_s:.0f} s: the motion was canceled"
        return self._reason(result.result())

    def _reason(self, response: Any) -> str:
        if response.status == GoalStatus.STATUS_SUCCEEDED or getattr(response.result, "stalled", False):
            return ""
        text = getattr(response.result, "error_string", "") or _ENDS.get(response.status, f"status {response.status}")
        return f"{self.route.name} did not finish the motion: {text}"

    def _goal(self, trajectory: JointTrajectory) -> Any:
        goal, last = self._action.Goal(), trajectory.points[-1]
        if self._action is FollowJointTrajectory:
            goal.trajectory = trajectory
        elif self._action is GripperCommand:
            goal.command.position = last.positions[0]
        else:
            goal.command.name, goal.command.position = list(trajectory.joint_names), list(last.positions)
        return goal


class ForwardController:
    """Controller that is commanded through a topic. The controller moves to the last point within its limits, along a
    path that it chooses itself."""

    def __init__(self, node: Node, route: Route, joints: JointMonitor) -> None:
        self.route = route
        self._joints = joints
        self._waiter = Waiter(node)
        self._name = node.resolve_topic_name(f"{route.name}/commands")
        self._commands = node.create_publisher(Float64MultiArray, self._name, 10)

    async def follow(self, trajectory: JointTrajectory, stop: StopRequest) -> str:
        """Send the last point, and wait until the joints have arrived or are at rest, for example because they hold an
        object."""
        is_ready = await self._waiter.until_ready(ANSWER_S, self._has_listener, stop.future)
        if stop.requested:
            return ""
        if not is_ready:
            return f"no controller listens to {self._name}: start the stack, and activate {self.route.name}"
        state = self._joints.state()
        goals = dict(zip(trajectory.joint_names, trajectory.points[-1].positions, strict=True))
        targets = [goals.get(joint, state[joint]) for joint in self.route.joints]
        self._commands.publish(Float64MultiArray(data=targets))
        duration_s = seconds_of(trajectory.points[-1].time_from_start)
        await self._rest(targets, duration_s, stop)
        if stop.requested:
            state = self._joints.state()
            self._commands.publish(Float64MultiArray(data=[state[joint] for joint in self.route.joints]))
        return ""

    def _has_listener(self) -> bool:
        return bool(self._commands.get_subscription_count())

    async def _rest(self, targets: list[float], duration_s: float, stop: StopRequest) -> None:
        """Wait until the joints have arrived, or until they are at rest after the duration of the trajectory."""
        before, still_s, waited_s = self._positions(), 0.0, 0.0
        while not stop.requested and waited_s < duration_s * SLACK + SLACK_S:
            await self._waiter.until(POLL_S, stop.future)
            waited_s += POLL_S
            now = self._positions()
            moved = max(abs(one - other) for one, other in zip(before, now, strict=True))
            still_s, before = (still_s + POLL_S if moved < STILL else 0.0), now
            arrived = all(abs(at - goal) < CLOSE for at, goal in zip(now, targets, strict=True))
            if still_s >= REST_S and (arrived or waited_s >= duration_s + REST_S):
                return

    def _positions(self) -> list[float]:
        state = self._joints.state()
        return [state[joint] for joint in self.route.joints]


def _cancel_if_accepted(sent: Future) -> None:
    """Cancel a goal that was accepted after the timeout, because no client waits for its motion."""
    if sent.result() is not None and sent.result().accepted:
        sent.result().cancel_goal_async()
