"""What is put on a node for a while, and taken off again while the node stays."""

from collections.abc import Iterable, Iterator
from typing import Any, Final

from rclpy.action import ActionClient, ActionServer

from nodes.controller_parameters import ParameterNode

_DESTROY: Final = {
    "publishers": "destroy_publisher",
    "subscriptions": "destroy_subscription",
    "services": "destroy_service",
    "clients": "destroy_client",
    "timers": "destroy_timer",
    "guards": "destroy_guard_condition",
}
_CALLBACKS: Final = tuple(f"_{when}_set_parameters_callbacks" for when in ("pre", "on", "post"))


class Additions:
    """All that is put on ``node`` from now on: publishers and the like, actions, parameters and their callbacks."""

    def __init__(self, node: ParameterNode) -> None:
        self._node = node
        self._waitables = list(node.waitables)
        self._entities = {kind: list(getattr(node, kind)) for kind in _DESTROY}
        self._callbacks = {name: list(getattr(node, name)) for name in _CALLBACKS}
        self._parameters = node.parameter_names

    def take_off(self) -> None:
        """The node is as it was when this was made."""
        node = self._node
        for waitable in _new(node.waitables, self._waitables):
            if isinstance(waitable, ActionServer | ActionClient):  # the others go with what they belong to
                waitable.destroy()
        for kind, before in self._entities.items():
            for entity in _new(getattr(node, kind), before):
                getattr(node, _DESTROY[kind])(entity)
        for name, callbacks in self._callbacks.items():
            getattr(node, name)[:] = callbacks
        for parameter in node.parameter_names - self._parameters:
            node.forget_parameter(parameter)


def _new(now: Iterable[Any], before: Iterable[Any]) -> Iterator[Any]:
    known = {id(entity) for entity in before}
    return (entity for entity in list(now) if id(entity) not in known)
