"""Who is loaded, and the life cycles of controllers, as far as no joint is concerned."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from controller.interface import Controller, indices
from controller.order import Order
from controller.switching import Loaded, ManagerError, taken
from hal.lifecycle import LifecycleState

UNCONFIGURED, INACTIVE = LifecycleState.UNCONFIGURED, LifecycleState.INACTIVE
KEPT_TRANSITIONS: Final = 1000
"""So many are kept for a reader that lags behind."""


class ClaimError(ManagerError):
    """A controller commands what the hardware has not."""


@dataclass(frozen=True, slots=True)
class Transition:
    """A controller went from one state to another."""

    name: str
    start: LifecycleState
    goal: LifecycleState


class Roster:
    """All that changes something is called in the loop's thread, or before that thread begins.

    Any thread may look at ``loaded``, which is replaced as a whole and never changed.
    """

    def __init__(self, command_interfaces: Sequence[str]) -> None:
        """``command_interfaces`` are the hardware's, in the order of its commands (``joint1/position``)."""
        self.command_interfaces = tuple(command_interfaces)
        self.transitions: deque[Transition] = deque(maxlen=KEPT_TRANSITIONS)
        """For one reader in another thread, who takes them from the left."""
        self._loaded: Mapping[str, Loaded] = {}
        self._running: tuple[Loaded, ...] = ()

    @property
    def loaded(self) -> Mapping[str, Loaded]:
        """All that are loaded, by name."""
        return self._loaded

    @property
    def controllers(self) -> Mapping[str, Controller]:
        """All that are configured, by name."""
        return {name: entry.controller for name, entry in self._loaded.items() if entry.controller is not None}

    @property
    def claimed(self) -> Mapping[str, str]:
        """Who has which command interface."""
        return taken(self._loaded)

    def state(self, name: str) -> LifecycleState:
        """The life cycle state of a controller. Raises KeyError where it is not loaded."""
        return self._loaded[name].state

    def settled(self, name: str) -> bool:
        """Whether that controller has settled; one that is not there has nothing to wait for."""
        entry = self._loaded.get(name)
        return entry is None or not entry.active or entry.controller is None or entry.controller.settled()

    # Life cycles

    def load(self, order: Order) -> None:
        """Take it in, unconfigured."""
        if order.name in self._loaded:
            raise ManagerError(f"A controller named '{order.name}' was already loaded inside the controller manager")
        self._put(Loaded(order))

    def configure(self, name: str, controller: Controller) -> None:
        """Give it its controller, built from its order. An inactive one is cleaned up first."""
        entry = self.changeable(name, "configured")
        unknown = [claim for claim in controller.command_interfaces if claim not in self.command_interfaces]
        if unknown:
            has = ", ".join(self.command_interfaces)
            raise ClaimError(f"{name} commands {', '.join(unknown)}, which the hardware has not (it has {has})")
        index = indices(controller.command_interfaces, self.command_interfaces)
        self.cleanup(name)
        self._put(Loaded(entry.order, INACTIVE, controller, index))

    def add(self, controller: Controller) -> None:
        """Load and configure one that has been built already."""
        self.load(Order(controller.name, controller.kind, controller.parameters))
        self.configure(controller.name, controller)

    def cleanup(self, name: str) -> None:
        """Back to unconfigured."""
        entry = self.changeable(name, "cleaned up")
        if entry.state is not UNCONFIGURED:
            self._put(Loaded(entry.order))

    def unload(self, name: str) -> None:
        """Forget it."""
        self.changeable(name, "unloaded")
        self.cleanup(name)
        self._hold({other: entry for other, entry in self._loaded.items() if other != name})

    def reorder(self, order: Order) -> None:
        """Other parameters for one that is loaded, from its next configuration on."""
        if order.name in self._loaded:
            self._hold({**self._loaded, order.name: replace(self._loaded[order.name], order=order)})

    def changeable(self, name: str, verb: str) -> Loaded:
        """The controller, which must be there and not active to be ``verb``. From any thread. Raises ManagerError."""
        if name not in self._loaded:
            raise ManagerError(f"Controller '{name}' can not be {verb}: no controller with this name exists")
        if self._loaded[name].active:
            raise ManagerError(f"Controller '{name}' can not be {verb} while it is active: deactivate it first")
        return self._loaded[name]

    def _put(self, entry: Loaded) -> None:
        before = self._loaded.get(entry.name)
        if before is not None and before.state is not entry.state:
            self.transitions.append(Transition(entry.name, before.state, entry.state))
        self._hold({**self._loaded, entry.name: entry})

    def _hold(self, loaded: Mapping[str, Loaded]) -> None:
        self._loaded = loaded
        self._running = tuple(entry for entry in loaded.values() if entry.active)
