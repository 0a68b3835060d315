"""``servoloop pick``: one goal of the pick-place action."""

from typing import Annotated

import typer

from drivers.errors import DriverError
from nodes.ros_environment import require_ros
from servoloop.processes import Interrupted
from servoloop.verbs.ros_options import NetworkOption, set_network


def pick(
    grade: Annotated[str, typer.Argument(help="Grade of the cube: A, B or C.")],
    network: NetworkOption = False,
) -> None:
    """Send one pick-place goal, print its feedback, and exit with 0 if it succeeds.

    Example: `servoloop pick B`
    """
    if not grade.strip():
        raise DriverError("GRADE is empty, and every pick-place node refuses that: name one, such as A")
    require_ros()
    from nodes.client_node import client_node
    from nodes.pick_place.client import ACTION, PickClient
    from servoloop.signals import Signals

    set_network(network)
    left = "the node may go on with the job"
    with Signals(left) as signals, client_node("servoloop_pick") as (node, executor):
        client = PickClient(node, executor)
        there = client.wait(5.0, lambda: signals.count > 0)
        if signals.count:
            raise Interrupted("interrupted before the job began")
        if not there:
            raise DriverError(f"nobody offers {ACTION}: start the stack and the pick-place node")
        outcome = client.pick(
            grade, lambda phase, message: typer.echo(f"{phase}: {message}"), lambda: signals.count > 0
        )
    typer.echo(("done: " if outcome.success else "failed: ") + outcome.message)
    raise typer.Exit(0 if outcome.success else 1)
