"""``ros2 service``: list and call services."""

from typing import Annotated

import typer

from servoloop_ros2.session import print_names, session
from servoloop_ros2.values import fill, find_type, read_values

app = typer.Typer(no_args_is_help=True, help="List and call services.")


@app.command("list")
def list_services(
    show_types: Annotated[bool, typer.Option("--show-types", "-t", help="Also print types.")] = False,
) -> None:
    """List the services."""
    with session() as found:
        print_names(found.names(found.node.get_service_names_and_types), show_types)


@app.command()
def call(
    name: Annotated[str, typer.Argument(help="Name of the service.")],
    kind: Annotated[str, typer.Argument(metavar="TYPE", help="Type of the service.")],
    values: Annotated[str, typer.Argument(help="Fields of the request as YAML.")] = "{}",
) -> None:
    """Call a service, and print its response."""
    cls, fields = find_type(kind, "srv"), read_values(values)
    with session() as found:
        request = cls.Request()
        fill(request, fields, found.node.get_clock().now().to_msg())
        print(f"requester: making request: {request!r}\n", flush=True)
        print(f"response:\n{found.call(cls, name, request)!r}\n")
