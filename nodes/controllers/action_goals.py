"""Track the running goals of one action. This module accepts goals, and the control loop determines their results."""

from collections.abc import Callable
from functools import partial
from typing import Any, Final, Generic, Protocol, TypeVar

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from controller.action_goals import GoalStatus
from nodes.publishing import EVERY_CALL
from nodes.rclpy_patches.client_limits import CLIENT_LIMITS

RESULT_TIMEOUT_S: Final = 10
"""Time for which a result remains available to clients, in seconds, as in ros2_control. With rclpy's default of 15 min,
every status message would list all goals of the last 15 minutes, and responses would be delayed after several hundred
goals."""
STOPPED: Final = "Stopped by another client, such as servoloop stop"
"""Result text of a goal that is aborted because a client of the command socket has canceled it."""


class AcceptedGoal(Protocol):
    """An accepted goal. The loop thread determines the result of the goal."""

    @property
    def done(self) -> bool: ...
    @property
    def status(self) -> GoalStatus: ...


Handle = TypeVar("Handle", bound=AcceptedGoal)


def make_action_server(
    node: Node,
    kind: Any,
    name: str,
    goals: "ActionGoals[Any]",
    on_goal: Callable[[Any], GoalResponse],
    on_accepted: Callable[[ServerGoalHandle], None],
) -> ActionServer:
    """Create an action server for goals whose results are determined by the control loop."""
    server = ActionServer(
        node,
        kind,
        name,
        execute_callback=goals.execute,
        goal_callback=on_goal,
        handle_accepted_callback=on_accepted,
        cancel_callback=goals.on_cancel,
        # With the default queue size of ten, a client that floods the server would displace other clients' requests.
        goal_service_qos_profile=EVERY_CALL,
        cancel_service_qos_profile=EVERY_CALL,
        result_service_qos_profile=EVERY_CALL,
        result_timeout=RESULT_TIMEOUT_S,
    )
    goals.wake = partial(_wake, node)
    CLIENT_LIMITS.add_action(server, node.resolve_topic_name(name))
    return server


def _wake(node: Node) -> None:
    """Wake the executor of a node after a change that allows a waiting callback to continue."""
    post = getattr(node.executor, "post", None)
    if post is not None:
        post()


class ActionGoals(Generic[Handle]):
    """Goals of one action. Only one thread at a time may call the methods of this class.

    ``cancel`` forwards a cancel request to the controller, and ``result`` creates the result of the action.
    """

    def __init__(self, cancel: Callable[[Handle], None], result: Callable[[Handle], Any]) -> None:
        self._cancel = cancel
        self._result = result
        self._handles: dict[bytes, Handle] = {}
        self._undecided: dict[bytes, tuple[ServerGoalHandle, Future]] = {}
        self.wake: Callable[[], None] = lambda: None
        """Function that wakes the executor, which then sends results."""

    @property
    def waiting(self) -> bool:
        """Whether a client waits for a result."""
        return bool(self._undecided)

    def accept(self, server_goal: ServerGoalHandle, handle: Handle) -> None:
        """Register an accepted goal. The server calls ``execute`` only in the next iteration of the executor."""
        key = bytes(server_goal.goal_id.uuid)
        self._handles[key] = handle
        self._undecided[key] = (server_goal, Future())
        server_goal.execute()

    def on_cancel(self, server_goal: ServerGoalHandle) -> CancelResponse:
        """Handle a cancel request (``cancel_callback`` of the server)."""
        handle = self._handles.get(bytes(server_goal.goal_id.uuid))
        if handle is None or handle.done:
            return CancelResponse.REJECT
        self._cancel(handle)
        return CancelResponse.ACCEPT

    def publish_feedback(self, feedback: Any) -> None:
        """Publish the feedback of a cycle for all undecided goals."""
        for key, (server_goal, _) in self._undecided.items():
            if not self._handles[key].done:
                server_goal.publish_feedback(feedback)

    def finish_decided(self) -> None:
        """Finish the goals whose results have been decided."""
        decided = [key for key in self._undecided if self._handles[key].done]
        for key in decided:
            _, future = self._undecided.pop(key)
            future.set_result(None)
        if decided:
            self.wake()

    async def execute(self, server_goal: ServerGoalHandle) -> Any:
        """Wait for the goal's result without blocking the executor (``execute_callback`` of the server)."""
        key = bytes(server_goal.goal_id.uuid)
        if key in self._undecided:
            await self._undecided[key][1]
        handle, aborted = self._handles.pop(key), False
        # If a cancel request was accepted just as the goal finished, the server considers the goal to be canceling.
        # A canceling goal cannot succeed.
        if handle.status is GoalStatus.CANCELED and server_goal.is_cancel_requested:
            server_goal.canceled()
        elif handle.status is GoalStatus.SUCCEEDED:
            server_goal.succeed()
        else:
            server_goal.abort()
            aborted = True
        result = self._result(handle)
        if aborted and handle.status is GoalStatus.CANCELED and hasattr(result, "error_string"):
            result.error_string = STOPPED
        return result
