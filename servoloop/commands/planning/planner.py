"""Code shared by the commands for the motion planner: the move_group client and pose options."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.driver_errors import DriverError
from nodes.ros_environment import require_ros
from servoloop.commands.shared.options import NetworkOption, set_network
from servoloop.extras import require_extras
from servoloop.stack.arm_options import NamespaceOption
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import Signals

if TYPE_CHECKING:
    from nodes.planning_client.move_group import MoveGroupClient
    from planning.scene import Pose

LEFT: Final = "the arm finishes its current motion and holds its position"
"""Message printed after a second signal."""
Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class PoseOptions:
    """Options for a pose, in addition to its position."""

    rpy: Annotated[
        Triple | None, typer.Option("--rpy", metavar="ROLL PITCH YAW", help="Roll, pitch and yaw angles in rad.")
    ] = None
    frame: Annotated[str, typer.Option("--frame", help="Frame of the pose (default: the base of the arm).")] = ""
    network: NetworkOption = False
    namespace: NamespaceOption = ""


@contextmanager
def move_group(name: str, network: bool, namespace: str) -> "Iterator[MoveGroupClient]":
    """Provide a client of move_group in a namespace for the command ``name``.

    Raises:
        DriverError: An extra is missing.
        RosError: ROS 2 is missing.
        Interrupted: The user interrupted the command.
    """
    require_extras(f"servoloop {name}", "planning")
    require_ros()
    from nodes.clients.client_node import client_node
    from nodes.planning_client.move_group import MoveGroupClient, UserInterruptError

    set_network(network)
    with Signals(LEFT) as signals, client_node(f"servoloop_{name}", namespace) as (node, executor):
        try:
            yield MoveGroupClient(node, executor, lambda: signals.count > 0)
        except UserInterruptError as error:
            raise Interrupted("interrupted; a running motion is canceled") from error


def pose_of(position_m: Triple, rpy: Triple | None) -> "Pose":
    """Return a pose. Raises DriverError if a number is not finite."""
    import numpy as np

    from planning.scene import Pose
    from planning.scene_file import rotation

    angles = rpy or (0.0, 0.0, 0.0)
    if not np.all(np.isfinite([*position_m, *angles])):
        raise DriverError(f"the pose {position_m}, {angles} must be finite: use numbers in m and rad")
    return Pose(np.array(position_m), rotation(*angles))
