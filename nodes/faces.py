"""The face of a controller: its ROS node. A kind that has none of its own has a node with nothing but its name."""

from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Final, Protocol

from builtin_interfaces.msg import Time
from rclpy.node import Node

from controller.forward_command_controller import ForwardCommandController
from controller.interface import Controller
from controller.joint_state_broadcaster import JointStateBroadcaster
from controller.joint_trajectory_controller import JointTrajectoryController
from nodes.forward_node import ForwardNode
from nodes.joint_state_node import JointStateNode
from nodes.trajectory_node import TrajectoryNode

ENTRY_POINTS: Final = "servoloop.faces"
"""The group of entry points in which a user's package names the faces of its controllers, by their ``type``."""


class Face(Protocol):
    """Lives in the ROS thread, from the controller's configuration to its end."""

    @property
    def node(self) -> Node: ...

    def publish(self, stamp: Time) -> None:
        """A cycle has ended: ``stamp`` is the ROS time of its measurement."""
        ...


class PlainFace:
    """A node of the controller's name."""

    def __init__(self, controller: Controller) -> None:
        self.node = Node(controller.name)

    def publish(self, stamp: Time) -> None:
        """There is nothing to say."""


@cache
def _makers() -> Mapping[str, Callable[[Any], Face]]:
    found: dict[str, Callable[[Any], Face]] = {
        JointTrajectoryController.kind: TrajectoryNode,
        ForwardCommandController.kind: ForwardNode,
        JointStateBroadcaster.kind: JointStateNode,
    }
    return found | {point.name: point.load() for point in entry_points(group=ENTRY_POINTS)}


def face_of(controller: Controller) -> Face:
    """Its node, on the graph from now on."""
    return _makers().get(controller.kind, PlainFace)(controller)
