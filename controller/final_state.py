"""Describe the final state of a component for the log when the program exits."""

from collections.abc import Sequence
from dataclasses import dataclass

from hal.components.component import Component
from hal.hardware import Reactivating
from hal.lifecycle import LifecycleState


@dataclass(frozen=True, slots=True)
class FinalState:
    """State of a component before the component is switched off. ``describe`` adds the outcome of switching it off."""

    component: Component
    active: bool
    released: frozenset[str]
    """Joints whose torque was off even though the component was active."""
    release_errors: Sequence[str] | None
    """Errors that occurred while the torque of a lost, inactive component was disabled. None if torque could not be
    disabled or no attempt was made.
    """

    @classmethod
    def of(cls, component: Component, release_errors: Sequence[str] | None = None) -> "FinalState":
        """Record the state of a component before it is switched off."""
        hardware = component.hardware
        released = hardware.without_torque if isinstance(hardware, Reactivating) else frozenset()
        return cls(component, hardware.state is LifecycleState.ACTIVE, released, release_errors)

    def describe(self, relax: bool, parked: bool, problems: Sequence[str]) -> str:
        """Describe the final state of the component. ``problems`` lists the errors that occurred while the component
        was switched off."""
        name = self.component.name
        if self.release_errors is not None:
            return self._describe_release(self.release_errors)
        if self.component.error is not None and not (self.active and relax):
            return f"{name} was lost: its servos hold their last goal if their torque is enabled"
        if not self.active:
            return f"{name} was not active: its torque is unchanged"
        if problems:
            return f"the torque of {name} may still be enabled: {'; '.join(problems)}"
        if relax:
            where = "in its park pose" if parked else "where it stopped"
            return f"{name} is {where}, and its torque is off"
        return f"{name} holds its position with torque enabled (on_exit: hold){self._exceptions()}"

    def _describe_release(self, errors: Sequence[str]) -> str:
        if errors:
            return f"{self.component.name} was lost, and its torque may still be enabled: {'; '.join(errors)}"
        return f"{self.component.name} was lost and could not be parked: its torque was disabled where it stopped"

    def _exceptions(self) -> str:
        names = [joint for joint in self.component.hardware.joints if joint in self.released]
        return f", except {', '.join(names)}, whose torque was off" if names else ""
