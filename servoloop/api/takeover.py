"""Let one controller take joints over from the controllers that drive them, and give the joints back."""

import logging
from collections.abc import Callable

from controller.manager.switch import ManagerError, SwitchRequest
from servoloop.api.errors import ArmBusyError
from servoloop.stack.control_stack import ControlStack

LOG = logging.getLogger("servoloop")
InLoop = Callable[[Callable[[], None]], None]
"""Function that runs an action in the thread of the loop between two cycles, and returns after it."""


class Takeover:
    """Takeover of joints by one controller. The thread of the loop calls all methods between two cycles."""

    def __init__(self, stack: ControlStack, name: str) -> None:
        """``name`` is the name of the controller, which may be loaded later."""
        self._stack, self._name = stack, name
        self._former: tuple[str, ...] = ()

    @property
    def active(self) -> bool:
        """Whether the controller is active. Any thread may read this."""
        entry = self._stack.loop.manager.registry.loaded.get(self._name)
        return entry is not None and entry.active

    def take(self) -> None:
        """Activate the controller in place of the controllers that drive its joints. Raises ArmBusyError."""
        loop = self._stack.loop
        registry = loop.manager.registry
        claims = set(registry.loaded[self._name].commands)
        former = [e.spec.name for e in registry.running if claims.intersection(e.controller.command_interfaces)]
        try:
            request = SwitchRequest(activate=(self._name,), deactivate=tuple(former))
            loop.manager.switch(request, loop.within_limits)
        except ManagerError as error:
            raise ArmBusyError(f"{self._name} cannot take over: {error}") from error
        self._former = tuple(former)

    def give_back(self) -> None:
        """Activate the former controllers again. They start after the joints have slowed down within their limits."""
        loop = self._stack.loop
        inactive = tuple(name for name in self._former if not loop.manager.registry.loaded[name].active)
        try:
            request = SwitchRequest(activate=inactive, deactivate=(self._name,) * self.active)
            loop.manager.switch(request, loop.within_limits)
        except ManagerError as error:  # The joints hold their positions without a controller.
            LOG.error("the controllers before %s cannot continue: %s", self._name, error)
