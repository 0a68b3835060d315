"""``ros2 action``: list actions, and send goals."""

from textwrap import indent
from typing import Annotated, Any, Final

import typer
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, get_action_names_and_types

from servoloop_ros2.ros2_error import Ros2Error
from servoloop_ros2.session import SERVER_S, print_names, session
from servoloop_ros2.values import as_yaml, fill, find_type, read_values

app = typer.Typer(no_args_is_help=True, help="List actions and send goals.")
INDENT: Final = "    "
STATUSES: Final = {
    GoalStatus.STATUS_SUCCEEDED: "SUCCEEDED",
    GoalStatus.STATUS_ABORTED: "ABORTED",
    GoalStatus.STATUS_CANCELED: "CANCELED",
}


@app.command("list")
def list_actions(
    show_types: Annotated[bool, typer.Option("--show-types", "-t", help="Also print types.")] = False,
) -> None:
    """List the actions."""
    with session() as found:
        print_names(found.names(lambda: get_action_names_and_types(found.node)), show_types)


@app.command("send_goal")
def send_goal(
    name: Annotated[str, typer.Argument(help="Name of the action.")],
    kind: Annotated[str, typer.Argument(metavar="TYPE", help="Type of the action.")],
    goal: Annotated[str, typer.Argument(help="Fields of the goal as YAML.")],
    feedback: Annotated[bool, typer.Option("--feedback", "-f", help="Also print the feedback.")] = False,
) -> None:
    """Send a goal, and print its result. Ctrl-C cancels the goal."""
    cls, fields = find_type(kind, "action"), read_values(goal)
    with session() as found:
        client = ActionClient(found.node, cls, name)
        print("Waiting for an action server to become available...", flush=True)
        if not found.spin_until(client.server_is_ready, SERVER_S):
            raise Ros2Error(
                f"no program offers the action {name}: start the program, or check the name with ros2 action list"
            )
        message = cls.Goal()
        fill(message, fields, found.node.get_clock().now().to_msg())
        print(f"Sending goal:\n{indent(as_yaml(message), INDENT)}", flush=True)
        handle = found.result(client.send_goal_async(message, _print_feedback if feedback else None), name)
        if not handle.accepted:
            raise Ros2Error("the goal was rejected: the log of the action's program contains the reason")
        print(f"Goal accepted with ID: {bytes(handle.goal_id.uuid).hex()}\n", flush=True)
        try:
            answer = found.result(handle.get_result_async(), name, None)
        except KeyboardInterrupt:
            found.result(handle.cancel_goal_async(), name)
            print("Goal canceled.")
            raise
        client.destroy()
    print(f"Result:\n{indent(as_yaml(answer.result), INDENT)}")
    print(f"Goal finished with status: {STATUSES.get(answer.status, 'UNKNOWN')}")


def _print_feedback(message: Any) -> None:
    print(f"Feedback:\n{indent(as_yaml(message.feedback), INDENT)}", flush=True)
