"""Create the interface nodes of controllers: the topics, services and actions of each controller type."""

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
"""Entry point group in which a package registers interface nodes for its controllers, keyed by controller ``type``."""


@runtime_checkable
class NewestCycleNode(Protocol):
    """An interface node that publishes only the latest state of its controller."""

    def publish(self, stamp: Time) -> None:
        """Publish the state after one or more cycles. ``stamp`` is the ROS time of the latest measurement."""
        ...


@runtime_checkable
class EveryCycleNode(Protocol):
    """An interface node that publishes every cycle, even if the ROS thread lags behind the control loop."""

    def publish_cycle(self, state: JointState, stamp: Time) -> None:
        """Publish the measured state of one cycle, with its ROS time."""
        ...


ControllerInterfaceNode = NewestCycleNode | EveryCycleNode
"""An interface node that has ``publish``, ``publish_cycle`` or both. ``publish`` is called after ``publish_cycle`` has
been called for all cycles.

The methods of the interface node never run at the same time as a callback of a node. The interface node exists from the
configuration of its controller until the cleanup. The interface node is created as ``Class(node, controller)``. The
manager creates ``node`` with the controller's name, parameters and remappings when the controller is loaded, and keeps
the node until the controller is unloaded. At cleanup, the manager removes everything that the interface node has added
to ``node``.
"""


class PlainNode:
    """Interface node of a controller type without ROS interfaces. The ROS node of such a controller has only
    parameters."""

    def __init__(self, node: Node, controller: Controller) -> None:
        self.node = node

    def publish(self, stamp: Time) -> None:
        """Do nothing, because the controller has no topics."""


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
    """Add a controller's interface to ``node``. Exceptions raised by an installed interface class are passed to the
    caller."""
    installed = entry_points(group=ENTRY_POINTS, name=controller.kind)
    maker = next((point.load() for point in installed), _OURS.get(controller.kind, PlainNode))
    interface: ControllerInterfaceNode = maker(node, controller)
    return interface
