"""The interface nodes of the controllers: the topics, services and actions that each kind has on its ROS node."""

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Any, Final, Protocol, runtime_checkable

from builtin_interfaces.msg import Time
from rclpy.node import Node

from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster
from controller.broadcasters.servo_state_broadcaster import ServoStateBroadcaster
from controller.forward.forward_command_controller import (
    ForwardCommandController,
    JointGroupEffortController,
    JointGroupPositionController,
    JointGroupVelocityController,
)
from controller.gripper.gripper_action_controller import GripperActionController, PositionGripperActionController
from controller.interface import Controller
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from nodes.controllers.broadcasters import JointStateNode, ServoStateNode
from nodes.controllers.forward import ForwardNode
from nodes.controllers.gripper import ParallelGripperNode, PositionGripperNode
from nodes.controllers.trajectory import TrajectoryNode

ENTRY_POINTS: Final = "servoloop.controller_nodes"
"""The group of entry points in which a user's package names its controllers' interface nodes, by their ``type``."""


@runtime_checkable
class NewestCycleNode(Protocol):
    """Publishes the newest state of its controller."""

    def publish(self, stamp: Time) -> None:
        """A cycle has ended, or several: ``stamp`` is the ROS time of the newest one's measurement."""
        ...


@runtime_checkable
class EveryCycleNode(Protocol):
    """Publishes every cycle, also those that the ROS thread is behind with."""

    def publish_cycle(self, state: JointState, stamp: Time) -> None:
        """A cycle has ended: what it measured, and the ROS time of that."""
        ...


ControllerInterfaceNode = NewestCycleNode | EveryCycleNode
"""An interface node has one of these methods, or both: then ``publish`` comes after every cycle has been published.

Lives in the ROS thread, from the controller's configuration to its cleanup. Built as
``Class(node, controller)``: the manager makes the node (its name, parameters, remappings), which stays from load to
unload, and takes off it everything that this object has added.
"""


class PlainNode:
    """The interface node of a kind that has none of its own: parameters only."""

    def __init__(self, node: Node, controller: Controller) -> None:
        self.node = node

    def publish(self, stamp: Time) -> None:
        """There is nothing to publish."""


_OURS: Final[Mapping[str, Callable[[Node, Any], ControllerInterfaceNode]]] = {
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


def interface_node_of(node: Node, controller: Controller) -> ControllerInterfaceNode:
    """Add the interface of the controller's kind to ``node``. Raises what an installed class raises."""
    installed = entry_points(group=ENTRY_POINTS, name=controller.kind)
    maker = next((point.load() for point in installed), _OURS.get(controller.kind, PlainNode))
    interface: ControllerInterfaceNode = maker(node, controller)
    return interface
