"""The commands of ``ros2``, and the errors that a user can correct."""

import os
import sys

import typer

from drivers.driver_errors import DriverError
from nodes.ros_environment import RosError
from servoloop_ros2 import action, control, node, param, service, topic
from servoloop_ros2.ros2_error import Ros2Error

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Inspect and command a ROS 2 system. A full ROS 2 installation has more commands.",
)
for group, name in (
    (topic, "topic"),
    (action, "action"),
    (service, "service"),
    (node, "node"),
    (param, "param"),
    (control, "control"),
):
    app.add_typer(group.app, name=name)


def main() -> None:
    """Run a command. Errors that a user can correct are printed without a traceback."""
    try:
        app(prog_name="ros2")
    except (Ros2Error, DriverError, RosError) as error:
        print(f"ros2: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    except BrokenPipeError:  # The reader of the output, such as head, has exited.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
