"""The controllers' ROS nodes: they come and go with the controllers."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from builtin_interfaces.msg import Time
from lifecycle_msgs.msg import State, TransitionEvent
from lifecycle_msgs.msg import Transition as TransitionMessage
from rclpy.executors import Executor
from rclpy.publisher import Publisher

from controller.desk import Desk
from controller.interface import Controller
from controller.kinds import kinds
from controller.manager import ControllerManager
from controller.order import Order
from controller.roster import Transition
from controller.switching import Loaded
from hal.lifecycle import LifecycleState
from hal.types import JointState
from nodes.additions import Additions
from nodes.controller_parameters import QUIET, ControllerParameters, ParameterNode
from nodes.faces import CycleFace, Face, NewestFace, face_of

LOG = logging.getLogger("servoloop.nodes")

LAST_CYCLES = 2
"""So many more a node lives that is no longer wanted: goals that ended with it get their results."""

_VERBS = {
    (LifecycleState.UNCONFIGURED, LifecycleState.INACTIVE): ("configure", "configuring"),
    (LifecycleState.INACTIVE, LifecycleState.UNCONFIGURED): ("cleanup", "cleaningup"),
    (LifecycleState.INACTIVE, LifecycleState.ACTIVE): ("activate", "activating"),
    (LifecycleState.ACTIVE, LifecycleState.INACTIVE): ("deactivate", "deactivating"),
}
"""Of each transition: its label, and that of the state on the way."""


def state_message(state: LifecycleState) -> State:
    """A life cycle state as ROS has it."""
    return State(id=state.value, label=state.name.lower())


def transition_events(transition: Transition, stamp_ns: int) -> list[TransitionEvent]:
    """Upstream tells each transition twice: that it begins, and that it has arrived."""
    verb, on_the_way = _VERBS[transition.start, transition.goal]
    start, goal = state_message(transition.start), state_message(transition.goal)
    between = State(id=getattr(State, f"TRANSITION_STATE_{on_the_way.upper()}"), label=on_the_way)
    begun = TransitionMessage(id=getattr(TransitionMessage, f"TRANSITION_{verb.upper()}"), label=verb)
    done_id = getattr(TransitionMessage, f"TRANSITION_ON_{verb.upper()}_SUCCESS")
    done = TransitionMessage(id=done_id, label="transition_success")
    return [
        TransitionEvent(timestamp=stamp_ns, transition=begun, start_state=start, goal_state=between),
        TransitionEvent(timestamp=stamp_ns, transition=done, start_state=between, goal_state=goal),
    ]


@dataclass(slots=True)
class _Shown:
    """A controller that is on the graph."""

    node: ParameterNode
    events: Publisher
    orders: list[Order]
    """What it was loaded by, and what its parameters have made of that: the loop may lag behind the newest."""
    controller: Controller | None = None
    """That the face shows."""
    face: Face | None = None
    additions: Additions | None = None
    """What the face has put on the node."""
    cycles_left: int = LAST_CYCLES

    def stands_for(self, entry: Loaded | None) -> bool:
        """Whether it still is the node of this controller, and not of one of its name that was loaded since.

        Orders that the loop has come past are forgotten.
        """
        while entry is not None and self.orders and self.orders[0] is not entry.order:
            del self.orders[0]
        return entry is not None and bool(self.orders)


class ControllerNodes:
    """One node for each loaded controller, with a face where it is configured. All in the ROS thread."""

    def __init__(self, manager: ControllerManager, desk: Desk, executor: Executor) -> None:
        self._manager = manager
        self._desk = desk
        self._executor = executor
        self._shown: dict[str, _Shown] = {}
        self._leaving: dict[str, _Shown] = {}
        self._seen: object = None
        self._there = True

    @property
    def controllers(self) -> Iterator[Controller]:
        """Those that have a face."""
        return (shown.controller for shown in self._shown.values() if shown.controller is not None)

    def publish(self, stamp: Time, cycles: Sequence[tuple[JointState, Time]] = ()) -> None:
        """So many cycles have ended since the last call, with their stamps; ``stamp`` is the newest one's."""
        for shown in (*self._shown.values(), *self._leaving.values()):
            if shown.face is not None:
                try:
                    if isinstance(shown.face, CycleFace):
                        for cycle in cycles:
                            shown.face.show(*cycle)
                    if isinstance(shown.face, NewestFace):
                        shown.face.publish(stamp)
                except Exception:  # a plug-in's, mostly: the others are still to be shown
                    LOG.exception("%s shows nothing from here on", shown.node.get_name())
                    shown.face = None

    def follow(self) -> bool:
        """Bring the graph to what the manager has; returns whether it is there, or needs another cycle."""
        if self._manager.loaded is self._seen and self._there:
            return True
        seen = self._manager.loaded
        for name in [n for n, shown in self._shown.items() if not shown.stands_for(seen.get(n))]:
            self._leaving[name] = self._shown.pop(name)
        self._bury()
        for name, entry in seen.items():
            if name not in self._leaving:
                if name not in self._shown:
                    self._shown[name] = self._show(entry.order)
                self._dress(self._shown[name], entry.controller)
        self._tell()
        self._seen = seen
        self._there = not self._leaving and all(self._shown[n].controller is e.controller for n, e in seen.items())
        return self._there

    def close(self) -> None:
        """All off the graph."""
        for shown in (*self._shown.values(), *self._leaving.values()):
            _destroy(shown)

    def _bury(self) -> None:
        for name, shown in list(self._leaving.items()):
            shown.cycles_left -= 1
            if shown.cycles_left < 0:
                del self._leaving[name]
                self._executor.remove_node(shown.node)
                _destroy(shown)

    def _show(self, order: Order) -> _Shown:
        node, orders = self._node(order), [order]
        events = node.create_publisher(TransitionEvent, "~/transition_event", 10, event_callbacks=QUIET)
        try:
            settable: frozenset[str] = getattr(kinds().get(order.kind), "settable", frozenset())
            ControllerParameters(
                node, order.parameters, settable, lambda new: orders.append(self._desk.change(order.name, new))
            )
        except Exception:  # a plug-in's, mostly: the other controllers' clients still wait for their answers
            LOG.exception("%s does its work, but its ROS node lacks what failed here", order.name)
        self._executor.add_node(node)
        return _Shown(node, events, orders)

    @staticmethod
    def _dress(shown: _Shown, controller: Controller | None) -> None:
        """Give it the controller's face, when that of another one has had its last cycles."""
        if shown.controller is controller:
            return
        if shown.additions is not None:
            shown.cycles_left -= 1
            if shown.cycles_left >= 0:
                return
            _undress(shown)
        shown.controller = controller
        if controller is not None:
            shown.additions = Additions(shown.node)
            try:
                shown.face = face_of(shown.node, controller)
            except Exception:  # a plug-in's, mostly
                LOG.exception("%s does its work, but its ROS node lacks what failed here", controller.name)

    @staticmethod
    def _node(order: Order) -> ParameterNode:
        try:
            return ParameterNode(order.name, cli_args=list(order.node_arguments) or None)
        except Exception as error:  # rcl's, which has no name of its own here
            LOG.error("%s: its node arguments %s are not used: %s", order.name, order.node_arguments, error)
            return ParameterNode(order.name)

    def _tell(self) -> None:
        """Every transition since the last time."""
        while self._manager.transitions:
            transition = self._manager.transitions.popleft()
            shown = self._shown.get(transition.name) or self._leaving.get(transition.name)
            if shown is not None:
                stamp_ns = shown.node.get_clock().now().nanoseconds
                for event in transition_events(transition, stamp_ns):
                    shown.events.publish(event)


def _undress(shown: _Shown) -> None:
    if shown.additions is not None:
        shown.additions.take_off()
    shown.controller = shown.face = shown.additions = None
    shown.cycles_left = LAST_CYCLES


def _destroy(shown: _Shown) -> None:
    """Off the graph: the face before its node, which would leave action servers behind, and their names with them."""
    _undress(shown)
    shown.node.destroy_node()
