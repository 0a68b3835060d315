"""The manager's client asks the manager from another thread: calls return at once, and are served between cycles."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from controller.loop import ControlLoop
from controller.manager.controller_spec import ControllerSpec, name_mistake
from controller.manager.controllers_file import no_type
from controller.manager.factory import Factory
from controller.manager.plugins import controller_types, look_for_plugins_again
from controller.manager.requests import Request
from controller.manager.settings import Settings
from controller.manager.switch import ManagerError, SwitchError, SwitchRequest
from controller.parameters import Parameters

SWITCH_TIMEOUT_S: Final = 1.0
"""The timeout of a client that names none."""


class ManagerClient:
    """The client is for one thread, not the loop's; work that takes long (files, plug-ins) is done in that thread.

    Each call raises errors that are known at once; errors that the loop finds, the request's ``result()`` raises. A
    refused call changes nothing.
    """

    def __init__(self, loop: ControlLoop, factory: Factory) -> None:
        self._loop = loop
        self._manager = loop.manager
        self._factory = factory
        self._changes: dict[str, tuple[ControllerSpec, Request[None]]] = {}
        """By controller: the newest change of its parameters, which the loop may not have come to yet."""

    def load(self, name: str, settings: Settings) -> Request[None]:
        """Take a controller in; the arguments as for ``Factory.spec``."""
        if name in self._manager.registry.loaded:
            raise ManagerError(f"A controller named '{name}' was already loaded inside the controller manager")
        if not name:
            raise ManagerError(no_type(name))
        if mistake := name_mistake(name):
            raise ManagerError(f"{name} {mistake}")
        spec = self._factory.spec(name, settings)
        return self._ask(lambda: self._manager.registry.load(spec))

    def configure(self, name: str) -> Request[None]:
        """Build a controller anew from its spec."""
        spec = self._newest(name)
        controller = self._factory.make(spec)

        def configure() -> None:
            now = self._manager.registry.loaded.get(name)
            if now is not None and now.spec is not spec:
                raise ManagerError(f"Controller '{name}' was changed meanwhile: configure it once more")
            self._manager.registry.configure(name, controller)

        return self._ask(configure)

    def cleanup(self, name: str) -> Request[None]:
        """Bring a controller back to unconfigured."""
        return self._ask(lambda: self._manager.registry.cleanup(name))

    def unload(self, name: str) -> Request[None]:
        """Forget a controller."""
        return self._ask(lambda: self._manager.registry.unload(name))

    def switch(self, request: SwitchRequest, timeout_s: float = 0.0) -> Request[str]:
        """Switch in one cycle, or not at all if that cycle comes later than ``timeout_s`` (0: a second)."""
        allowed_s = timeout_s if timeout_s > 0.0 else SWITCH_TIMEOUT_S
        latest_s = self._loop.clock.now() + allowed_s

        def switch() -> str:
            if self._loop.clock.now() > latest_s:
                raise SwitchError(f"Switch controller timed out after {allowed_s:f} seconds! Nothing was switched.")
            return self._manager.switch(request, self._loop.within_limits)

        return self._loop.requests.ask(switch)

    def change(self, name: str, parameters: Parameters) -> ControllerSpec:
        """Other parameters for a controller; returns its spec from then on. Raises ValueError if it refuses them."""
        entry = self._manager.registry.loaded.get(name)
        if entry is None:
            raise ValueError(f"{name} is not loaded any more")
        if entry.controller is not None:
            reconfigure: Callable[[Parameters], None] | None = getattr(entry.controller, "reconfigure", None)
            if reconfigure is None:
                raise ValueError(f"{entry.spec.kind} cannot take it while it is configured: clean it up first")
            reconfigure(parameters)
        spec = replace(entry.spec, parameters=parameters)
        self._changes[name] = spec, self._ask(lambda: self._manager.registry.update_spec(spec))
        return spec

    def _newest(self, name: str) -> ControllerSpec:
        """The spec to build a configuration from: as the loop will have it when it comes to that."""
        spec, request = self._changes.get(name, (None, None))
        under_way = request is not None and not request.done  # before the look at what the loop has
        entry = self._manager.registry.changeable(name, "configured")
        return spec if under_way and spec is not None else entry.spec

    def configured(self, name: str) -> bool:
        """Whether the controller is loaded and has been built."""
        entry = self._manager.registry.loaded.get(name)
        return entry is not None and entry.controller is not None

    def reload(self, force: bool) -> Request[None]:
        """Unload all controllers and look for plug-ins again; active ones only by ``force``."""

        def reload() -> None:
            self._manager.clear(force)
            look_for_plugins_again()

        return self._ask(reload)

    def controller_types(self) -> list[str]:
        """The types that can be loaded."""
        return list(controller_types())

    def _ask(self, action: Callable[[], None]) -> Request[None]:
        return self._loop.requests.ask(action)
