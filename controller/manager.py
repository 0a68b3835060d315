"""The controllers of one robot: who claims which joint, and one cycle of all of them."""

from collections.abc import Mapping, Sequence

from controller.interface import Controller, indices
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointState


class ClaimError(Exception):
    """Two controllers want the same command interface."""


class ControllerManager:
    """Holds the controllers in the order in which they run."""

    def __init__(self, joints: Sequence[str]) -> None:
        self.command_interfaces = tuple(f"{joint}/position" for joint in joints)
        self._controllers: dict[str, Controller] = {}
        self._index: dict[str, list[int]] = {}
        self._states: dict[str, LifecycleState] = {}

    @property
    def controllers(self) -> Mapping[str, Controller]:
        """All controllers by name."""
        return self._controllers

    def state(self, name: str) -> LifecycleState:
        """The life cycle state of a controller."""
        return self._states[name]

    def add(self, controller: Controller) -> None:
        """Take a configured controller in. Raises ClaimError if its joints are taken."""
        for other in self._controllers.values():
            common = sorted(set(controller.command_interfaces) & set(other.command_interfaces))
            if common:
                raise ClaimError(
                    f"{controller.name} and {other.name} both command {', '.join(common)}: "
                    "a joint belongs to one controller"
                )
        self._controllers[controller.name] = controller
        self._index[controller.name] = indices(controller.command_interfaces, self.command_interfaces)
        self._states[controller.name] = LifecycleState.INACTIVE

    def activate(self, state: JointState, command: FloatArray) -> None:
        """All controllers take over; ``command`` (n,) is what the hardware holds."""
        for name, controller in self._controllers.items():
            controller.activate(state, command[self._index[name]])
            self._states[name] = LifecycleState.ACTIVE

    def deactivate(self) -> None:
        """All controllers give up what is under way, each of them; then raises what the first one raised."""
        errors: list[Exception] = []
        for name, controller in self._controllers.items():
            if self._states[name] is LifecycleState.ACTIVE:
                self._states[name] = LifecycleState.INACTIVE
                try:
                    controller.deactivate()
                except Exception as error:  # the others' clients still wait for a word
                    errors.append(error)
        if errors:
            raise errors[0]

    def update(self, state: JointState, last: FloatArray, now_s: float, period_s: float) -> FloatArray:
        """One cycle: the wanted command (n,); a joint that nobody commands keeps ``last``."""
        wanted = last.copy()
        for name, controller in self._controllers.items():
            if self._states[name] is LifecycleState.ACTIVE:
                controller.update(state, now_s, period_s)
                wanted[self._index[name]] = controller.command
        return wanted

    def settled(self, name: str) -> bool:
        """Whether that controller has settled; one that is not there has nothing to wait for."""
        controller = self._controllers.get(name)
        active = self._states.get(name) is LifecycleState.ACTIVE
        return controller is None or not active or controller.settled()
