"""The face of a controller: what its kind offers on the controller's ROS node beside parameters."""

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Any, Final, Protocol, runtime_checkable

from builtin_interfaces.msg import Time
from rclpy.node import Node

from controller.forward_command_controller import (
    ForwardCommandController,
    JointGroupEffortController,
    JointGroupPositionController,
    JointGroupVelocityController,
)
from controller.gripper_action_controller import GripperActionController, PositionGripperActionController
from controller.interface import Controller
from controller.joint_state_broadcaster import JointStateBroadcaster
from controller.joint_trajectory_controller import JointTrajectoryController
from controller.servo_state_broadcaster import ServoStateBroadcaster
from hal.types import JointState
from nodes.forward_node import ForwardNode
from nodes.gripper_node import ParallelGripperNode, PositionGripperNode
from nodes.joint_state_node import JointStateNode
from nodes.servo_state_node import ServoStateNode
from nodes.trajectory_node import TrajectoryNode

ENTRY_POINTS: Final = "servoloop.faces"
"""The group of entry points in which a user's package names the faces of its controllers, by their ``type``."""


@runtime_checkable
class NewestFace(Protocol):
    """Shows what its controller says now."""

    def publish(self, stamp: Time) -> None:
        """A cycle has ended, or several: ``stamp`` is the ROS time of the newest one's measurement."""
        ...


@runtime_checkable
class CycleFace(Protocol):
    """Shows every cycle, also those that the ROS side is behind with."""

    def show(self, state: JointState, stamp: Time) -> None:
        """A cycle has ended: what it measured, and the ROS time of that."""
        ...


Face = NewestFace | CycleFace
"""One of them, or both: then ``publish`` comes after every cycle has been shown.

Lives in the ROS thread, from the controller's configuration to its cleanup. Built as ``Face(node, controller)``: the
manager makes the node (its name, parameters, remappings), which stays from load to unload, and takes off it everything
that the face has put there.
"""


class PlainFace:
    """Of a kind that has none of its own."""

    def __init__(self, node: Node, controller: Controller) -> None:
        self.node = node

    def publish(self, stamp: Time) -> None:
        """There is nothing to say."""


_OURS: Final[Mapping[str, Callable[[Node, Any], Face]]] = {
    JointTrajectoryController.kind: TrajectoryNode,
    ForwardCommandController.kind: ForwardNode,
    JointGroupPositionController.kind: ForwardNode,
    JointGroupVelocityController.kind: ForwardNode,
    JointGroupEffortController.kind: ForwardNode,
    GripperActionController.kind: ParallelGripperNode,
    PositionGripperActionController.kind: PositionGripperNode,
    JointStateBroadcaster.kind: JointStateNode,
    ServoStateBroadcaster.kind: ServoStateNode,
}


def face_of(node: Node, controller: Controller) -> Face:
    """What its kind offers, on ``node`` from now on. Raises what an installed face raises."""
    installed = entry_points(group=ENTRY_POINTS, name=controller.kind)
    maker = next((point.load() for point in installed), _OURS.get(controller.kind, PlainFace))
    face: Face = maker(node, controller)
    return face
