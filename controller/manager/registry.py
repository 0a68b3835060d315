"""The registry holds the loaded controllers and their life cycles, as far as no joint is concerned."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from controller.interface import Controller, indices
from controller.manager.controller_spec import ControllerSpec
from controller.manager.switch import Loaded, ManagerError, taken
from hal.lifecycle import LifecycleState

UNCONFIGURED, INACTIVE = LifecycleState.UNCONFIGURED, LifecycleState.INACTIVE
KEPT_TRANSITIONS: Final = 1000
"""So many transitions are kept for a reader that lags behind."""


class ClaimError(ManagerError):
    """A controller commands an interface that the hardware does not have."""


@dataclass(frozen=True, slots=True)
class Transition:
    """A controller went from one state to another."""

    name: str
    start: LifecycleState
    goal: LifecycleState


@dataclass(frozen=True, slots=True)
class Running:
    """An active controller as the cycle needs it."""

    spec: ControllerSpec
    controller: Controller
    index: list[int]
    """The places of its commands among the hardware's."""


class ControllerRegistry:
    """All calls that change something come from the loop's thread, or before that thread begins.

    Any thread may look at ``loaded`` and ``running``, which are replaced as a whole and never changed.
    """

    def __init__(self, command_interfaces: Sequence[str]) -> None:
        """``command_interfaces`` are the hardware's, in the order of its commands (``joint1/position``)."""
        self.command_interfaces = tuple(command_interfaces)
        self.transitions: deque[Transition] = deque(maxlen=KEPT_TRANSITIONS)
        """For one reader in another thread, which takes them from the left."""
        self.loaded: Mapping[str, Loaded] = {}
        """All loaded controllers by name, in the order in which they were loaded."""
        self.running: tuple[Running, ...] = ()
        """The active ones of them, in the same order."""

    @property
    def controllers(self) -> Mapping[str, Controller]:
        """All configured controllers, by name."""
        return {name: entry.controller for name, entry in self.loaded.items() if entry.controller is not None}

    @property
    def claimed(self) -> Mapping[str, str]:
        """The controller's name by the command interface that it has claimed."""
        return taken(self.loaded)

    def state(self, name: str) -> LifecycleState:
        """The life cycle state of a controller. Raises KeyError where it is not loaded."""
        return self.loaded[name].state

    def load(self, spec: ControllerSpec) -> None:
        """Take a controller in, unconfigured."""
        if spec.name in self.loaded:
            raise ManagerError(f"A controller named '{spec.name}' was already loaded inside the controller manager")
        self.put(Loaded(spec))

    def configure(self, name: str, controller: Controller) -> None:
        """Give a loaded name its controller, built from its spec. An inactive one is cleaned up first."""
        entry = self.changeable(name, "configured")
        unknown = [claim for claim in controller.command_interfaces if claim not in self.command_interfaces]
        if unknown:
            has = ", ".join(self.command_interfaces)
            raise ClaimError(f"{name} commands {', '.join(unknown)}, which the hardware has not (it has {has})")
        index = indices(controller.command_interfaces, self.command_interfaces)
        self.cleanup(name)
        self.put(Loaded(entry.spec, INACTIVE, controller, index))

    def add(self, controller: Controller) -> None:
        """Load and configure a controller that has been built already."""
        self.load(ControllerSpec(controller.name, controller.kind, controller.parameters))
        self.configure(controller.name, controller)

    def cleanup(self, name: str) -> None:
        """Bring a controller back to unconfigured."""
        entry = self.changeable(name, "cleaned up")
        if entry.state is not UNCONFIGURED:
            self.put(Loaded(entry.spec))

    def unload(self, name: str) -> None:
        """Forget a controller."""
        self.changeable(name, "unloaded")
        self.cleanup(name)
        self._hold({other: entry for other, entry in self.loaded.items() if other != name})

    def update_spec(self, spec: ControllerSpec) -> None:
        """Other parameters for a loaded controller, from its next configuration on."""
        if spec.name in self.loaded:
            self._hold({**self.loaded, spec.name: replace(self.loaded[spec.name], spec=spec)})

    def changeable(self, name: str, verb: str) -> Loaded:
        """The controller, which must be there and not active to be ``verb``. From any thread. Raises ManagerError."""
        if name not in self.loaded:
            raise ManagerError(f"Controller '{name}' can not be {verb}: no controller with this name exists")
        if self.loaded[name].active:
            raise ManagerError(f"Controller '{name}' can not be {verb} while it is active: deactivate it first")
        return self.loaded[name]

    def put(self, entry: Loaded) -> None:
        """Replace a controller's entry by this one; a change of its state is a transition."""
        before = self.loaded.get(entry.name)
        if before is not None and before.state is not entry.state:
            self.transitions.append(Transition(entry.name, before.state, entry.state))
        self._hold({**self.loaded, entry.name: entry})

    def _hold(self, loaded: Mapping[str, Loaded]) -> None:
        self.loaded = loaded
        self.running = tuple(
            Running(entry.spec, entry.controller, entry.index)
            for entry in loaded.values()
            if entry.active and entry.controller is not None
        )
