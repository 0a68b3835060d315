"""Where clients in other threads ask the manager: each call returns at once, and is fulfilled between two cycles."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from controller.factory import Factory
from controller.kinds import kinds, look_again
from controller.loop import ControlLoop
from controller.order import Order
from controller.parameters import Parameters
from controller.requests import Request
from controller.switching import ManagerError, SwitchError, Wish

SWITCH_TIMEOUT_S: Final = 1.0
"""Of a client that names none."""


class Desk:
    """For one thread, which is not the loop's: what takes long (files, plug-ins) is done in that thread.

    Each call raises what can be said at once; what the loop finds, the request's ``result()`` raises. Everything that
    is refused changes nothing.
    """

    def __init__(self, loop: ControlLoop, factory: Factory) -> None:
        self._loop = loop
        self._manager = loop.manager
        self._factory = factory
        self._changes: dict[str, tuple[Order, Request[None]]] = {}
        """By controller: the newest change of its parameters, which the loop may not have come to yet."""

    def load(
        self,
        name: str,
        kind: str,
        paths: Sequence[Path] = (),
        fallback: Sequence[str] = (),
        node_arguments: Sequence[str] = (),
    ) -> Request[None]:
        """Take a controller in; the arguments as for ``Factory.order``."""
        if name in self._manager.loaded:
            raise ManagerError(f"A controller named '{name}' was already loaded inside the controller manager")
        if not name or not kind:
            raise ManagerError(
                f"The 'type' param was not defined for '{name}': set {name}.type on /controller_manager, "
                "or give the controller a section with its type in a parameter file"
            )
        order = self._factory.order(name, kind, paths, fallback, node_arguments)
        return self._ask(lambda: self._manager.load(order))

    def configure(self, name: str) -> Request[None]:
        """Build it anew from what was ordered."""
        order = self._newest(name)
        controller = self._factory.make(order)

        def configure() -> None:
            now = self._manager.loaded.get(name)
            if now is not None and now.order is not order:
                raise ManagerError(f"Controller '{name}' was changed meanwhile: configure it once more")
            self._manager.configure(name, controller)

        return self._ask(configure)

    def cleanup(self, name: str) -> Request[None]:
        """Back to unconfigured."""
        return self._ask(lambda: self._manager.cleanup(name))

    def unload(self, name: str) -> Request[None]:
        """Forget it."""
        return self._ask(lambda: self._manager.unload(name))

    def switch(self, wish: Wish, timeout_s: float = 0.0) -> Request[str]:
        """Switch in one cycle, or not at all if that cycle comes later than ``timeout_s`` (0: a second)."""
        allowed_s = timeout_s if timeout_s > 0.0 else SWITCH_TIMEOUT_S
        latest_s = self._loop.clock.now() + allowed_s

        def switch() -> str:
            if self._loop.clock.now() > latest_s:
                raise SwitchError(f"Switch controller timed out after {allowed_s:f} seconds! Nothing was switched.")
            return self._manager.switch(wish, self._loop.command)

        return self._loop.requests.ask(switch)

    def change(self, name: str, parameters: Parameters) -> Order:
        """Other parameters for a controller; returns its order from then on. Raises ValueError if it refuses them."""
        entry = self._manager.loaded.get(name)
        if entry is None:
            raise ValueError(f"{name} is not loaded any more")
        if entry.controller is not None:
            reconfigure: Callable[[Parameters], None] | None = getattr(entry.controller, "reconfigure", None)
            if reconfigure is None:
                raise ValueError(f"{entry.order.kind} cannot take it while it is configured: clean it up first")
            reconfigure(parameters)
        order = replace(entry.order, parameters=parameters)
        self._changes[name] = order, self._ask(lambda: self._manager.reorder(order))
        return order

    def _newest(self, name: str) -> Order:
        """What a configuration is to be built from: as the loop will have it when it comes to that."""
        order, request = self._changes.get(name, (None, None))
        under_way = request is not None and not request.done  # before the look at what the loop has
        entry = self._manager.changeable(name, "configured")
        return order if under_way and order is not None else entry.order

    def reload(self, force: bool) -> Request[None]:
        """Unload all controllers and look for plug-ins again; active ones only by ``force``."""

        def reload() -> None:
            self._manager.clear(force)
            look_again()

        return self._ask(reload)

    def kinds(self) -> list[str]:
        """The types that can be loaded."""
        return list(kinds())

    def _ask(self, action: Callable[[], None]) -> Request[None]:
        return self._loop.requests.ask(action)
