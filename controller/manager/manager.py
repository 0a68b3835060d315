"""Load controllers, and switch between controllers that command the joints."""

import logging
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np

from controller.interface import Controller, relieving
from controller.manager.cycle import ControllerCycle
from controller.manager.registry import ActiveEntry, ControllerRegistry
from controller.manager.suspended import SuspendedControllers
from controller.manager.switch import Interfaces, SwitchPlan, SwitchRequest, plan_switch
from controller.manager_errors import ManagerError, SwitchError
from controller.stops import DecelerationStops
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointLimits, JointState

LOG = logging.getLogger("servoloop.controller")

INACTIVE, ACTIVE = LifecycleState.INACTIVE, LifecycleState.ACTIVE


class ControllerManager:
    """Manager that loads controllers and switches between them.

    ``registry`` contains the loaded controllers, and ``cycle`` runs the active controllers. The threading rules of
    ``ControllerRegistry`` apply.
    """

    def __init__(self, hardware: Interfaces, limits: Mapping[str, JointLimits], outputs: Collection[str] = ()) -> None:
        """Create a manager without controllers.

        Args:
            hardware: The hardware with its command interfaces.
            limits: Limits of each joint, keyed by joint name. A joint that loses its controller stops within these
                limits.
            outputs: Command interfaces that do not move any joints.
        """
        self.registry = ControllerRegistry(hardware.command_interfaces, outputs)
        self.stops = DecelerationStops(hardware.command_interfaces, limits)
        self._hardware = hardware
        self.cycle = ControllerCycle(self.registry, self.stops, self._replace)
        self.suspended = SuspendedControllers(self.registry, hardware)

    def switch(self, request: SwitchRequest, command: FloatArray) -> str:
        """Switch all controllers of a request at once, or do not switch any of them.

        Args:
            request: Controllers to activate and to deactivate.
            command: Last command of the hardware, shape (n,).

        Returns:
            Summary of the switched controllers.

        Raises:
            SwitchError: Nothing was switched, or some of the previous controllers could not be reactivated.
        """
        plan = plan_switch(self.registry.loaded, request, self._hardware)
        for name in plan.deactivate:
            self._stop(name)
        try:
            for name in plan.activate:
                self._start(name, command)
        except Exception as error:
            LOG.exception("a controller cannot be activated, so no controllers were switched")
            raise SwitchError(f"{error}{self._undo(plan, command)}") from error
        for name in plan.activate:
            self.suspended.discard(name)
        summary = plan.summary()
        LOG.info("%s", summary.replace("\n", " "))
        return summary

    def _undo(self, plan: SwitchPlan, command: FloatArray) -> str:
        """Undo a switch that failed halfway. Return the last part of the error message."""
        for name in reversed(plan.activate):
            if self.registry.loaded[name].active:
                self._stop(name)
        errors = list[str]()
        for name in plan.deactivate:
            try:
                self._start(name, command)
            except Exception as error:  # The other controllers must continue.
                errors.append(f"; and {error}: the controller stays inactive and its joints hold position")
        return "".join(errors) or ". Nothing was switched."

    def activate(self, state: JointState, command: FloatArray) -> None:
        """Activate the controllers in loading order when the loop starts.

        Fallback controllers stay inactive, as do controllers whose joints another controller has claimed. ``command``
        (n,) is the last command sent to the hardware.
        """
        fallbacks = {name for entry in self.registry.loaded.values() for name in entry.spec.fallback}
        loaded = self.registry.loaded.items()
        self.activate_each([n for n, entry in loaded if entry.state is INACTIVE and n not in fallbacks], state, command)

    def activate_each(self, names: Iterable[str], state: JointState, command: FloatArray) -> None:
        """Activate controllers one after another. A controller that fails to activate stays inactive."""
        self.cycle.seen = state
        for name in names:
            try:
                self.switch(SwitchRequest(activate=(name,)), command)
            except SwitchError as error:
                LOG.warning("%s stays inactive: %s", name, error)

    def deactivate(self) -> None:
        """Deactivate all controllers, then raise the first error that occurred, if any."""
        errors = [error for entry in self.registry.running if (error := self._stop(entry.spec.name))]
        if errors:
            raise errors[0]

    def clear(self, force: bool) -> None:
        """Unload all controllers. Active controllers are unloaded only with ``force``."""
        running = [entry.spec.name for entry in self.registry.running]
        if running and not force:
            raise ManagerError(f"{', '.join(running)} cannot be unloaded while active: deactivate first, or use force")
        for name in running:
            self._stop(name)
        for name in self.registry.loaded:
            self.registry.unload(name)

    def release(self, interfaces: Iterable[str], reason: str, states: bool = False) -> list[str]:
        """Deactivate all controllers that use any of these command interfaces, and add them to ``suspended``.

        Args:
            interfaces: Names of the interfaces.
            reason: Reason for the deactivation, for the log and the goal results.
            states: Whether to also deactivate controllers that use one of the interfaces as a state interface.

        Returns:
            Names of the deactivated controllers.
        """
        lost, names = set(interfaces), list[str]()
        for entry in self.registry.running:
            read = entry.controller.state_interfaces if states else ()
            if used := lost.intersection((*entry.controller.command_interfaces, *read)):
                name = entry.spec.name
                LOG.error("%s is being deactivated because it uses %s: %s", name, ", ".join(sorted(used)), reason)
                self._stop(name, reason)
                names.append(name)
        self.suspended.add(names)
        return names

    def _replace(self, failed: ActiveEntry, last: FloatArray) -> None:
        """Deactivate a failed controller and activate its fallback controllers, which start in the next cycle."""
        self._stop(failed.spec.name)
        if failed.spec.fallback:
            try:
                self.switch(SwitchRequest(activate=failed.spec.fallback), last)
            except SwitchError as error:
                LOG.error("the fallback of %s cannot take over: %s", failed.spec.name, error)

    def _start(self, name: str, command: FloatArray) -> None:
        entry = self.registry.loaded[name]
        self.cycle.take(entry.index)
        held = self.stops.ends(command)[entry.index]
        if self.cycle.seen is None or not np.isfinite(held).all():
            raise SwitchError(f"Could not activate controller '{name}': its joints have not been measured yet")
        try:
            entry.configured.activate(self.cycle.seen, held)
        except Exception as error:
            _deactivated(entry.configured)
            raise SwitchError(f"Could not activate controller '{name}': {error}") from error
        self.registry.put(replace(entry, state=ACTIVE))

    def _stop(self, name: str, reason: str = "") -> Exception | None:
        """Deactivate a controller, even if it raises an error. Return the error."""
        entry = self.registry.loaded[name]
        self.registry.put(replace(entry, state=INACTIVE))
        error = _deactivated(entry.configured, reason)
        self.cycle.stop(entry.index)
        if error is None and (controller := relieving(entry.configured)):
            self.cycle.leaving.add(controller, entry.index)
        return error


def _deactivated(controller: Controller, reason: str = "") -> Exception | None:
    try:
        controller.deactivate(reason)
    except Exception as error:  # Clients of the other controllers are still waiting for their results.
        LOG.exception("%s failed when it was deactivated", controller.name)
        return error
    return None
