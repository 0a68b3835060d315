"""Remember the controllers that were deactivated because their joints could no longer be commanded."""

from collections.abc import Collection, Iterable

from controller.manager.registry import ControllerRegistry
from controller.manager.switch import Interfaces, taken


class SuspendedControllers:
    """Controllers that were deactivated because their component was lost or their torque was disabled.

    ``Arm.torque(True)`` activates these controllers again. Only the loop thread calls the methods.
    """

    def __init__(self, registry: ControllerRegistry, hardware: Interfaces) -> None:
        self._registry, self._hardware = registry, hardware
        self._names: dict[str, None] = {}

    def add(self, names: Iterable[str]) -> None:
        """Remember controllers that have been deactivated."""
        for name in names:
            self.discard(name)
            self._names[name] = None

    def discard(self, name: str) -> None:
        """Forget a controller, because it has been activated or is no longer needed."""
        self._names.pop(name, None)

    def resumable(self, deactivate: Collection[str] = ()) -> tuple[str, ...]:
        """Return the controllers that can be activated again, in the order in which they were deactivated.

        If two controllers use the same interface, only the controller that was deactivated last is returned.

        Args:
            deactivate: Active controllers that will be deactivated in the same switch.
        """
        claimed, names = set(taken(self._registry.loaded, without=deactivate)), list[str]()
        for name in reversed(self._names):
            entry = self._registry.loaded.get(name)
            if entry is None or entry.controller is None or entry.active:
                continue
            if claimed.isdisjoint(entry.commands) and all(map(self._hardware.ready, entry.commands)):
                claimed.update(entry.commands)
                names.append(name)
        return tuple(reversed(names))
