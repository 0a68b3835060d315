"""Create and destroy the ROS nodes of the controllers as the controllers are loaded and unloaded."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from builtin_interfaces.msg import Time
from lifecycle_msgs.msg import TransitionEvent
from rclpy.executors import Executor

from controller.interface import Controller
from controller.manager.client import ManagerClient
from controller.manager.controller_spec import ControllerSpec
from controller.manager.manager import ControllerManager
from controller.manager.plugins import controller_types
from controller.manager.registry import Transition
from controller.manager.switch import Loaded
from hal.types import JointState
from nodes.controllers.controller_parameters import ControllerParameters
from nodes.controllers.interface_nodes import (
    ControllerInterfaceNode,
    EveryCycleNode,
    NewestCycleNode,
    interface_node_of,
)
from nodes.controllers.node_entities import NodeEntities
from nodes.lifecycle_messages import transition_events
from nodes.parameter_node import NO_EVENT_CALLBACKS, ParameterNode
from nodes.ros_time import RosTime

LOG = logging.getLogger("servoloop.nodes")

LAST_CYCLES = 2
"""Number of extra cycles for which a node exists after its controller is unloaded, so that clients receive results."""

_INCOMPLETE = "controller %s is running, but its ROS node is incomplete because of this error"


class ControllerNode:
    """ROS node of one loaded controller. The node has topics, services and actions while its controller is
    configured."""

    def __init__(self, spec: ControllerSpec, manager_client: ManagerClient, ros_time: RosTime) -> None:
        self.node = _make_node(spec, ros_time)
        self._transitions = self.node.create_publisher(
            TransitionEvent, "~/transition_event", 10, event_callbacks=NO_EVENT_CALLBACKS
        )
        self._specs = [spec]
        """The original specification and all specifications created by parameter changes. The control loop may not be
        using the latest specification yet."""
        self.controller: Controller | None = None
        """Controller to which the interface node belongs."""
        self._set_interface(None)
        self._interface_entities: NodeEntities | None = None
        self._cycles_left = LAST_CYCLES
        try:
            settable: frozenset[str] = getattr(controller_types().get(spec.kind), "settable", frozenset())
            ControllerParameters(
                self.node,
                spec.parameters,
                settable,
                lambda new: self._specs.append(manager_client.change(spec.name, new)),
                lambda: manager_client.configured(spec.name),
            )
        except Exception:  # Other clients are still waiting for responses.
            LOG.exception(_INCOMPLETE, spec.name)

    def belongs_to(self, entry: Loaded | None) -> bool:
        """Return whether ``entry`` is the controller of this node and not a later controller with the same name.

        Discard all specifications that are older than that of ``entry``.
        """
        while entry is not None and self._specs and self._specs[0] is not entry.spec:
            del self._specs[0]
        return entry is not None and bool(self._specs)

    def publish(self, stamp: Time, cycles: Sequence[tuple[JointState, Time]]) -> None:
        """Publish cycles with their stamps. ``stamp`` is the stamp of the latest cycle."""
        try:
            if self._every_cycle is not None:
                for cycle in cycles:
                    self._every_cycle.publish_cycle(*cycle)
            if self._newest_cycle is not None:
                self._newest_cycle.publish(stamp)
        except Exception:  # An error must not prevent the other controllers from publishing.
            LOG.exception("controller %s stops publishing because of this error", self.node.get_name())
            self._set_interface(None)

    def publish_transition(self, transition: Transition) -> None:
        """Publish the two lifecycle events of a transition."""
        for event in transition_events(transition, self.node.get_clock().now().nanoseconds):
            self._transitions.publish(event)

    def last_cycles_are_over(self) -> bool:
        """Count one of the extra cycles of a node or an interface, and return whether all extra cycles have passed."""
        self._cycles_left -= 1
        return self._cycles_left < 0

    def set_controller(self, controller: Controller | None) -> None:
        """Add the interface of ``controller`` once the extra cycles of the previous interface have passed."""
        if self.controller is controller or (self._interface_entities is not None and not self.last_cycles_are_over()):
            return
        self._remove_interface()
        self.controller = controller
        if controller is not None:
            self._interface_entities = NodeEntities(self.node)
            try:
                self._set_interface(interface_node_of(self.node, controller))
            except Exception:  # A plugin may raise any exception.
                LOG.exception(_INCOMPLETE, controller.name)

    def destroy(self) -> None:
        """Destroy the action servers, which rclpy would otherwise leave in the ROS graph, and then the node."""
        self._remove_interface()
        self.node.destroy_node()

    def _set_interface(self, interface: ControllerInterfaceNode | None) -> None:
        """Set the interface. The protocols that the interface node implements are checked only once, because these
        checks are slow."""
        self._interface = interface
        self._every_cycle = interface if isinstance(interface, EveryCycleNode) else None
        self._newest_cycle = interface if isinstance(interface, NewestCycleNode) else None

    def _remove_interface(self) -> None:
        if self._interface_entities is not None:
            self._interface_entities.remove()
        self.controller = self._interface_entities = None
        self._set_interface(None)
        self._cycles_left = LAST_CYCLES


class ControllerNodes:
    """ROS nodes of all loaded controllers. Only one thread at a time may call the methods of this class."""

    def __init__(
        self, manager: ControllerManager, manager_client: ManagerClient, executor: Executor, ros_time: RosTime
    ) -> None:
        self._manager = manager
        self._manager_client = manager_client
        self._executor = executor
        self._ros_time = ros_time
        self._nodes: dict[str, ControllerNode] = {}
        self._unloaded: dict[str, ControllerNode] = {}
        self._failed: dict[str, Loaded] = {}
        """Controllers whose nodes could not be updated. The update of such a node is retried only after its controller
        changes."""
        self._synchronized_with: object = None
        self._complete = True

    @property
    def controllers(self) -> Iterator[Controller]:
        """Controllers whose nodes have interfaces."""
        return (node.controller for node in self._nodes.values() if node.controller is not None)

    @property
    def current(self) -> bool:
        """Whether the ROS graph matches the controller manager."""
        return self._manager.registry.loaded is self._synchronized_with and self._complete

    def publish(self, stamp: Time, cycles: Sequence[tuple[JointState, Time]] = ()) -> None:
        """Publish all cycles since the last call, each with its stamp. ``stamp`` is the stamp of the latest cycle."""
        for node in (*self._nodes.values(), *self._unloaded.values()):
            node.publish(stamp, cycles)

    def synchronize(self) -> bool:
        """Update the ROS graph to match the controller manager. Return False if another cycle is needed to complete the
        update."""
        if self.current:
            return True
        loaded = self._manager.registry.loaded
        for name in [name for name, node in self._nodes.items() if not node.belongs_to(loaded.get(name))]:
            self._unloaded[name] = self._nodes.pop(name)
        self._destroy_unloaded()
        self._failed = {name: entry for name, entry in self._failed.items() if loaded.get(name) is entry}
        for name, entry in loaded.items():
            if name not in self._unloaded and name not in self._failed:
                self._update(name, entry)
        self._publish_transitions()
        self._synchronized_with = loaded
        self._complete = not self._unloaded and all(
            self._nodes[n].controller is e.controller for n, e in loaded.items() if n not in self._failed
        )
        return self._complete

    def close(self) -> None:
        """Destroy all nodes."""
        for node in (*self._nodes.values(), *self._unloaded.values()):
            node.destroy()

    def _destroy_unloaded(self) -> None:
        for name, node in list(self._unloaded.items()):
            if node.last_cycles_are_over():
                del self._unloaded[name]
                self._executor.remove_node(node.node)
                with _logged(name):
                    node.destroy()

    def _update(self, name: str, entry: Loaded) -> None:
        """Update one node to match the controller manager. A failure does not delay the responses to clients of other
        controllers."""
        self._failed[name] = entry
        with _logged(name):
            if name not in self._nodes:
                self._add(entry.spec)
            self._nodes[name].set_controller(entry.controller)
            del self._failed[name]

    def _add(self, spec: ControllerSpec) -> None:
        self._nodes[spec.name] = ControllerNode(spec, self._manager_client, self._ros_time)
        self._executor.add_node(self._nodes[spec.name].node)

    def _publish_transitions(self) -> None:
        """Publish all transitions since the last call."""
        while self._manager.registry.transitions:
            transition = self._manager.registry.transitions.popleft()
            node = self._nodes.get(transition.name) or self._unloaded.get(transition.name)
            if node is not None:
                node.publish_transition(transition)


@contextmanager
def _logged(name: str) -> Iterator[None]:
    try:
        yield
    except Exception:
        LOG.exception(_INCOMPLETE, name)


def _make_node(spec: ControllerSpec, ros_time: RosTime) -> ParameterNode:
    try:
        return ParameterNode(spec.name, ros_time, cli_args=list(spec.node_arguments) or None)
    except Exception as error:  # The errors of rcl have no public base class.
        LOG.error("controller %s: its node arguments %s are ignored: %s", spec.name, spec.node_arguments, error)
        return ParameterNode(spec.name, ros_time)
