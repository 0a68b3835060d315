"""Store the loaded controllers and their lifecycle states. The registry does not command any joints."""

from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from controller.interface import Controller, indices
from controller.manager.controller_spec import ControllerSpec
from controller.manager.switch import Loaded, taken
from controller.manager_errors import ClaimError, ManagerError
from hal.lifecycle import LifecycleState

UNCONFIGURED, INACTIVE = LifecycleState.UNCONFIGURED, LifecycleState.INACTIVE
KEPT_TRANSITIONS: Final = 1000
"""Maximum number of transitions kept for a slow reader."""


@dataclass(frozen=True, slots=True)
class Transition:
    """A change in the state of a controller."""

    name: str
    start: LifecycleState
    goal: LifecycleState


@dataclass(frozen=True, slots=True)
class ActiveEntry:
    """An active controller and the data that the cycle needs."""

    spec: ControllerSpec
    controller: Controller
    index: list[int]
    """Indices of the controller's commands among the hardware's commands."""


class ControllerRegistry:
    """The loaded controllers.

    Only the loop thread may change the registry, except before the loop starts. Any thread may read ``loaded``
    and ``running``, because a change replaces these objects instead of modifying them.
    """

    def __init__(self, command_interfaces: Sequence[str], outputs: Collection[str] = ()) -> None:
        """Create an empty registry.

        Args:
            command_interfaces: Command interfaces of the hardware, such as ``joint1/position``, in hardware order.
            outputs: Command interfaces that do not move any joints, such as ``lamp/led``.
        """
        self.command_interfaces = tuple(command_interfaces)
        self._outputs = frozenset(outputs)
        self.transitions: deque[Transition] = deque(maxlen=KEPT_TRANSITIONS)
        """Transitions for a single reader in another thread, which removes them from the left."""
        self.loaded: Mapping[str, Loaded] = {}
        """All loaded controllers, keyed by name, in loading order."""
        self.running: tuple[ActiveEntry, ...] = ()
        """The active controllers, in loading order."""
        self.controllers: Mapping[str, Controller] = {}
        """All configured controllers, keyed by name."""

    @property
    def claimed(self) -> Mapping[str, str]:
        """Name of the controller that has claimed each command interface, keyed by interface."""
        return taken(self.loaded)

    def state(self, name: str) -> LifecycleState:
        """Return the lifecycle state of a controller. Raises KeyError if the controller is not loaded."""
        return self.loaded[name].state

    def load(self, spec: ControllerSpec) -> None:
        """Load a controller without configuring it."""
        if spec.name in self.loaded:
            raise ManagerError(f"A controller named '{spec.name}' was already loaded inside the controller manager")
        self.put(Loaded(spec))

    def configure(self, name: str, controller: Controller) -> None:
        """Configure a loaded controller with the object built from its spec.

        An inactive controller is cleaned up first.
        """
        entry = self.changeable(name, "configured")
        motions = [claim for claim in controller.command_interfaces if claim not in self._outputs]
        unknown = [claim for claim in motions if claim not in self.command_interfaces]
        if unknown:
            has = ", ".join((*self.command_interfaces, *sorted(self._outputs)))
            raise ClaimError(f"{name} claims {', '.join(unknown)}, which the hardware does not have (it has {has})")
        index = indices(motions, self.command_interfaces)
        self.cleanup(name)
        self.put(Loaded(entry.spec, INACTIVE, controller, index))

    def add(self, controller: Controller) -> None:
        """Load and configure a controller that has already been built."""
        self.load(ControllerSpec(controller.name, controller.kind, controller.parameters))
        self.configure(controller.name, controller)

    def cleanup(self, name: str) -> None:
        """Return a controller to the unconfigured state."""
        entry = self.changeable(name, "cleaned up")
        if entry.state is not UNCONFIGURED:
            self.put(Loaded(entry.spec))

    def unload(self, name: str) -> None:
        """Unload a controller."""
        self.changeable(name, "unloaded")
        self.cleanup(name)
        self._hold({other: entry for other, entry in self.loaded.items() if other != name})

    def update_spec(self, spec: ControllerSpec) -> None:
        """Set the spec that a loaded controller uses from its next configuration onward."""
        if spec.name in self.loaded:
            self._hold({**self.loaded, spec.name: replace(self.loaded[spec.name], spec=spec)})

    def changeable(self, name: str, verb: str) -> Loaded:
        """Return a loaded controller. Any thread may call this method.

        Raises ManagerError if the controller is not loaded or is active. ``verb`` specifies the operation in the
        message.
        """
        if name not in self.loaded:
            raise ManagerError(f"Controller '{name}' can not be {verb}: no controller with this name exists")
        if self.loaded[name].active:
            raise ManagerError(f"Controller '{name}' can not be {verb} while it is active: deactivate it first")
        return self.loaded[name]

    def put(self, entry: Loaded) -> None:
        """Replace the entry of a controller. Record a transition if the controller's state changes."""
        before = self.loaded.get(entry.name)
        if before is not None and before.state is not entry.state:
            self.transitions.append(Transition(entry.name, before.state, entry.state))
        self._hold({**self.loaded, entry.name: entry})

    def _hold(self, loaded: Mapping[str, Loaded]) -> None:
        self.loaded = loaded
        self.controllers = {name: entry.controller for name, entry in loaded.items() if entry.controller is not None}
        self.running = tuple(
            ActiveEntry(entry.spec, entry.controller, entry.index)
            for entry in loaded.values()
            if entry.active and entry.controller is not None
        )
