"""The controllers of one robot: who moves which joint, and one cycle of all of them."""

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from controller.coasting import Coasting
from controller.interface import Controller
from controller.roster import INACTIVE, Roster
from controller.switching import Loaded, ManagerError, Plan, SwitchError, Wish, plan_switch
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointState

LOG = logging.getLogger("servoloop.controller")

ACTIVE = LifecycleState.ACTIVE


class ControllerManager(Roster):
    """Runs the controllers in the order in which they were loaded; the threads as for ``Roster``."""

    def __init__(self, command_interfaces: Sequence[str]) -> None:
        """``command_interfaces`` are the hardware's, in the order of its commands (``joint1/position``)."""
        super().__init__(command_interfaces)
        self.hardware_ready: Callable[[str], bool] = lambda interface: True
        """Whether a command interface can be used now."""
        self.hardware_measured: Callable[[str], bool] = lambda interface: True
        """Whether a state interface can be used now."""
        self.coasting = Coasting(self.command_interfaces)
        self._command = self._last = np.full(len(self.command_interfaces), np.nan)
        self._period_s = 1.0
        self._seen: JointState | None = None

    # Switching

    def switch(self, wish: Wish, command: FloatArray) -> str:
        """All of it at once or nothing of it; returns what was done. ``command`` (n,) is what the hardware holds.

        Raises SwitchError, whose text says why not.
        """
        plan = plan_switch(self._loaded, wish, self.hardware_ready, self.hardware_measured)
        for name in plan.deactivate:
            self._stop(name)
        try:
            for name in plan.activate:
                self._start(name, command)
        except Exception as error:
            LOG.exception("a controller cannot be activated: nothing is switched")
            raise SwitchError(f"{error}{self._undo(plan, command)}") from error
        told = plan.told()
        LOG.info("%s", told.replace("\n", " "))
        return told

    def _undo(self, plan: Plan, command: FloatArray) -> str:
        """As it was before; returns what could not be brought back."""
        for name in reversed(plan.activate):
            if self._loaded[name].active:
                self._stop(name)
        for name in plan.deactivate:
            try:
                self._start(name, command)
            except Exception as error:
                return f"; and {error}: it stays inactive, its joints hold"
        return ". Nothing was switched."

    def activate(self, state: JointState, command: FloatArray) -> None:
        """At the start: each in its turn takes over, but for those whose joints are taken, and for fallbacks.

        ``command`` (n,) is what the hardware holds.
        """
        self._seen = state
        fallbacks = {name for entry in self._loaded.values() for name in entry.order.fallback}
        for name, entry in self._loaded.items():
            if entry.state is INACTIVE and name not in fallbacks:
                try:
                    self.switch(Wish(activate=(name,)), command)
                except SwitchError as error:
                    LOG.warning("%s stays inactive: %s", name, error)

    def deactivate(self) -> None:
        """All give up what is under way, each of them; then raises what the first one raised."""
        errors = [error for entry in self._running if (error := self._stop(entry.name))]
        if errors:
            raise errors[0]

    def clear(self, force: bool) -> None:
        """Forget all, active ones only by ``force``."""
        if self._running and not force:
            names = ", ".join(entry.name for entry in self._running)
            raise ManagerError(f"{names} cannot be unloaded while active: deactivate first, or force it")
        for entry in self._running:
            self._stop(entry.name)
        for name in self._loaded:
            self.unload(name)

    def release(self, interfaces: Iterable[str], reason: str, states: bool = False) -> None:
        """Deactivate all that use one of these command interfaces; with ``states``, one of these state interfaces."""
        lost = set(interfaces)
        for entry in self._running:
            used = lost.intersection(entry.commands) | (lost.intersection(entry.states) if states else set())
            if used:
                LOG.error("%s is deactivated, it uses %s: %s", entry.name, ", ".join(sorted(used)), reason)
                self._stop(entry.name, reason)

    def _start(self, name: str, command: FloatArray) -> None:
        entry = self._loaded[name]
        held = self.coasting.ends(command)[entry.index]
        if self._seen is None or not np.isfinite(held).all():
            raise SwitchError(f"Could not activate controller '{name}': its joints have not been measured yet")
        try:
            entry.running.activate(self._seen, held)
        except Exception as error:
            self._told_to_stop(entry.running)
            raise SwitchError(f"Could not activate controller '{name}': {error}") from error
        self._put(replace(entry, state=ACTIVE))

    def _stop(self, name: str, reason: str = "") -> Exception | None:
        """It is inactive after this, whatever it raises; that is returned."""
        entry = self._loaded[name]
        self._put(replace(entry, state=INACTIVE))
        error = self._told_to_stop(entry.running, reason)
        self.coasting.begin(entry.index, self._command, (self._command - self._last) / self._period_s)
        return error

    @staticmethod
    def _told_to_stop(controller: Controller, reason: str = "") -> Exception | None:
        try:
            controller.deactivate(reason)
        except Exception as error:  # the others' clients still wait for a word
            LOG.exception("%s failed when it was deactivated", controller.name)
            return error
        return None

    # One cycle

    def update(self, state: JointState, last: FloatArray, now_s: float, period_s: float) -> FloatArray:
        """One cycle: the wanted command (n,). What nobody commands is as ``last`` (n,) says.

        A controller that fails is deactivated; the others go on. One whose joints are still coming to rest from what
        another did begins when they stand.
        """
        self._seen = state
        wanted = last.copy()
        for entry in self._running:
            if self.coasting.holds(entry.index):
                continue
            try:
                entry.running.update(state, now_s, period_s)
                wanted[entry.index] = _shaped(entry)
            except Exception:
                LOG.exception("%s failed and is deactivated: its joints come to rest", entry.name)
                self._replace(entry, last)
        self.coasting.fill(wanted, period_s)
        self._command, self._last, self._period_s = wanted, last, period_s
        return wanted

    def sent(self, command: FloatArray) -> None:
        """What the safety gate has made of the last cycle's command (n,): joints come to rest from there."""
        self._command = command

    def _replace(self, failed: Loaded, last: FloatArray) -> None:
        """Its fallback controllers take over, from the next cycle on."""
        self._stop(failed.name)
        if failed.order.fallback:
            try:
                self.switch(Wish(activate=failed.order.fallback), last)
            except SwitchError as error:
                LOG.error("the fallback of %s cannot take over: %s", failed.name, error)


def _shaped(entry: Loaded) -> FloatArray:
    """Its command, which must be one value for each interface: numpy would spread a single one over all."""
    command = entry.running.command
    if command.shape != (len(entry.index),):
        raise ValueError(f"a command of shape {command.shape} for {len(entry.index)} interfaces")
    return command
