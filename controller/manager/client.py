"""Call the controller manager from another thread.

Calls return immediately, and the loop serves them between two cycles.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from controller.loop import ControlLoop
from controller.manager.controller_spec import ControllerSpec, name_mistake
from controller.manager.controllers_file import no_type
from controller.manager.factory import Factory
from controller.manager.plugins import controller_types, look_for_plugins_again
from controller.manager.requests import Request
from controller.manager.settings import ManagerSettings
from controller.manager.switch import SwitchRequest
from controller.manager_errors import ManagerError, SwitchError
from controller.parameters import Parameters

SWITCH_TIMEOUT_S: Final = 1.0
"""Default timeout of a switch, in seconds."""


class ManagerClient:
    """Client of the controller manager, for use in one thread other than the loop thread.

    Slow work, such as reading files and loading plugins, runs in the calling thread. Errors that occur in the calling
    thread are raised by the call itself. Errors that occur in the loop are raised by ``result()`` of the returned
    request. A call that raises an error does not change anything.
    """

    def __init__(self, loop: ControlLoop, factory: Factory) -> None:
        self._loop = loop
        self._manager = loop.manager
        self._factory = factory
        self._changes: dict[str, tuple[ControllerSpec, Request[None]]] = {}
        """Latest parameter change of each controller, keyed by name. The loop may not have applied the change yet."""

    def load(self, name: str, settings: ManagerSettings) -> Request[None]:
        """Load a controller. The arguments are the same as for ``Factory.spec``."""
        if name in self._manager.registry.loaded:
            raise ManagerError(f"A controller named '{name}' was already loaded inside the controller manager")
        if not name:
            raise ManagerError(no_type(name))
        if mistake := name_mistake(name):
            raise ManagerError(f"{name} {mistake}")
        spec = self._factory.spec(name, settings)
        return self._ask(lambda: self._manager.registry.load(spec))

    def configure(self, name: str) -> Request[None]:
        """Build a controller from its current spec and configure it."""
        spec = self._newest(name)
        controller = self._factory.make(spec)

        def configure() -> None:
            now = self._manager.registry.loaded.get(name)
            if now is not None and now.spec is not spec:
                raise ManagerError(f"Controller '{name}' was changed while it was being built: configure it again")
            self._manager.registry.configure(name, controller)

        return self._ask(configure)

    def cleanup(self, name: str) -> Request[None]:
        """Return a controller to the unconfigured state."""
        return self._ask(lambda: self._manager.registry.cleanup(name))

    def unload(self, name: str) -> Request[None]:
        """Unload a controller."""
        return self._ask(lambda: self._manager.registry.unload(name))

    def switch(self, request: SwitchRequest, timeout_s: float = 0.0) -> Request[str]:
        """Switch controllers in one cycle.

        If the cycle starts more than ``timeout_s`` from now, nothing is switched. A timeout of 0 selects
        ``SWITCH_TIMEOUT_S``.
        """
        allowed_s = timeout_s if timeout_s > 0.0 else SWITCH_TIMEOUT_S
        latest_s = self._loop.clock.now() + allowed_s

        def switch() -> str:
            if self._loop.clock.now() > latest_s:
                raise SwitchError(f"Switch controller timed out after {allowed_s:f} seconds! Nothing was switched.")
            return self._manager.switch(request, self._loop.within_limits)

        return self._loop.requests.ask(switch)

    def change(self, name: str, parameters: Parameters) -> ControllerSpec:
        """Change the parameters of a controller and return its new spec.

        Raises ValueError if the controller rejects the parameters.
        """
        entry = self._manager.registry.loaded.get(name)
        if entry is None:
            raise ValueError(f"{name} is no longer loaded")
        if entry.controller is not None:
            reconfigure: Callable[[Parameters], None] | None = getattr(entry.controller, "reconfigure", None)
            if reconfigure is None:
                raise ValueError(f"{entry.spec.kind} cannot change parameters while configured: clean it up first")
            reconfigure(parameters)
        spec = replace(entry.spec, parameters=parameters)
        self._changes[name] = spec, self._ask(lambda: self._manager.registry.update_spec(spec))
        return spec

    def _newest(self, name: str) -> ControllerSpec:
        """Return a controller's spec, including any parameter change that the loop has not applied yet."""
        spec, request = self._changes.get(name, (None, None))
        pending = request is not None and not request.done  # This check must come before the registry is read.
        entry = self._manager.registry.changeable(name, "configured")
        return spec if pending and spec is not None else entry.spec

    def configured(self, name: str) -> bool:
        """Return whether a controller is loaded and has been configured."""
        entry = self._manager.registry.loaded.get(name)
        return entry is not None and entry.controller is not None

    def reload(self, force: bool) -> Request[None]:
        """Unload all controllers and search for plugins again. Active controllers are unloaded only with ``force``."""

        def reload() -> None:
            self._manager.clear(force)
            look_for_plugins_again()

        return self._ask(reload)

    def controller_types(self) -> list[str]:
        """Return the available controller types."""
        return list(controller_types())

    def _ask(self, action: Callable[[], None]) -> Request[None]:
        return self._loop.requests.ask(action)
