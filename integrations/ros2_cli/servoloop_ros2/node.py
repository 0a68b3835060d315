"""``ros2 node``: list nodes."""

import typer

from servoloop_ros2.session import DISCOVERY_S, session

app = typer.Typer(no_args_is_help=True, help="List nodes.")


@app.command("list")
def list_nodes() -> None:
    """List the nodes."""
    with session() as found:
        found.spin(DISCOVERY_S)
        own = found.node.get_name()
        names = {
            f"{space.rstrip('/')}/{name}" for name, space in found.node.get_node_names_and_namespaces() if name != own
        }
        print("\n".join(sorted(names)))


@app.callback()
def _group() -> None:
    """Keep ``list`` as a separate command, because typer merges a single command with its group."""
