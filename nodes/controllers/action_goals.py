"""The goals of one action under way: accepted here, decided by the loop."""

from collections.abc import Callable
from typing import Any, Final, Generic, Protocol, TypeVar

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from controller.action_goals import GoalStatus
from nodes.publishing import EVERY_CALL
from nodes.rclpy_patches.client_limits import CLIENT_LIMITS

RESULT_TIMEOUT_S: Final = 10
"""So long a client can still ask for a result, as with upstream. rclpy's default is a quarter of an hour; every status
message names all goals of that time, and answers come late after some hundreds."""


class AcceptedGoal(Protocol):
    """An accepted goal; the loop's thread decides it."""

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
    """Make the server of an action whose goals are decided by the loop."""
    server = ActionServer(
        node,
        kind,
        name,
        execute_callback=goals.execute,
        goal_callback=on_goal,
        handle_accepted_callback=on_accepted,
        cancel_callback=goals.on_cancel,
        # A client that floods the server would push the others' requests out of a queue of ten.
        goal_service_qos_profile=EVERY_CALL,
        cancel_service_qos_profile=EVERY_CALL,
        result_service_qos_profile=EVERY_CALL,
        result_timeout=RESULT_TIMEOUT_S,
    )
    CLIENT_LIMITS.add_action(server, node.resolve_topic_name(name))
    return server


class ActionGoals(Generic[Handle]):
    """The goals of one action; all calls come from the ROS thread.

    ``cancel`` tells the controller, ``result`` makes the action's result.
    """

    def __init__(self, cancel: Callable[[Handle], None], result: Callable[[Handle], Any]) -> None:
        self._cancel = cancel
        self._result = result
        self._handles: dict[bytes, Handle] = {}
        self._undecided: dict[bytes, tuple[ServerGoalHandle, Future]] = {}

    @property
    def waiting(self) -> bool:
        """True while a client waits for a result."""
        return bool(self._undecided)

    def accept(self, server_goal: ServerGoalHandle, handle: Handle) -> None:
        """In the server's ``handle_accepted_callback``: ``execute`` runs only when the executor comes round again."""
        key = bytes(server_goal.goal_id.uuid)
        self._handles[key] = handle
        self._undecided[key] = (server_goal, Future())
        server_goal.execute()

    def on_cancel(self, server_goal: ServerGoalHandle) -> CancelResponse:
        """The server's ``cancel_callback``."""
        handle = self._handles.get(bytes(server_goal.goal_id.uuid))
        if handle is None or handle.done:
            return CancelResponse.REJECT
        self._cancel(handle)
        return CancelResponse.ACCEPT

    def publish_feedback(self, feedback: Any) -> None:
        """Publish the feedback of a cycle to the goals that are not decided."""
        for key, (server_goal, _) in self._undecided.items():
            if not self._handles[key].done:
                server_goal.publish_feedback(feedback)

    def finish_decided(self) -> None:
        """End the goals that are decided."""
        for key in [key for key in self._undecided if self._handles[key].done]:
            _, future = self._undecided.pop(key)
            future.set_result(None)

    async def execute(self, server_goal: ServerGoalHandle) -> Any:
        """The server's ``execute_callback``: waits for the decision without holding up the executor."""
        key = bytes(server_goal.goal_id.uuid)
        if key in self._undecided:  # else it has been decided already
            await self._undecided[key][1]
        handle = self._handles.pop(key)
        # A goal that ends in the instant in which its cancel is accepted is canceling for the action server,
        # which then allows no success.
        if handle.status is GoalStatus.CANCELED and server_goal.is_cancel_requested:
            server_goal.canceled()
        elif handle.status is GoalStatus.SUCCEEDED:
            server_goal.succeed()
        else:
            server_goal.abort()
        return self._result(handle)
