"""Remove the ROS entities that a controller's interface has added to its node."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Any, Final

from rclpy.action import ActionClient, ActionServer

from nodes.parameter_node import ParameterNode

_DESTROY: Final = {
    "publishers": "destroy_publisher",
    "subscriptions": "destroy_subscription",
    "services": "destroy_service",
    "clients": "destroy_client",
    "timers": "destroy_timer",
    "guards": "destroy_guard_condition",
}


class NodeEntities:
    """All publishers, other ROS entities, parameters and callbacks added to ``node`` after this object was created."""

    def __init__(self, node: ParameterNode) -> None:
        self._node = node
        self._waitables = list(node.waitables)
        self._entities = {kind: list(getattr(node, kind)) for kind in _DESTROY}
        self._callbacks = list(node.parameter_callbacks)
        self._parameters = node.parameter_names

    def remove(self) -> None:
        """Restore the node to the state it was in when this object was created."""
        node = self._node
        for waitable in _new(node.waitables, self._waitables):
            if isinstance(waitable, ActionServer | ActionClient):  # Other entities are removed with their owners.
                waitable.destroy()
        for kind, before in self._entities.items():
            for entity in _new(getattr(node, kind), before):
                getattr(node, _DESTROY[kind])(entity)
        for remove, callback in _new(node.parameter_callbacks, self._callbacks):
            with suppress(ValueError):  # The entity's owner has already removed it.
                remove(callback)
        node.parameter_callbacks = self._callbacks
        for parameter in node.parameter_names - self._parameters:
            node.forget_parameter(parameter)


def _new(now: Iterable[Any], before: Iterable[Any]) -> Iterator[Any]:
    known = {id(entity) for entity in before}
    return (entity for entity in list(now) if id(entity) not in known)
