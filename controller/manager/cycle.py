"""The controllers' cycle updates all active controllers, one after the other, and puts their commands together."""

import logging
from collections.abc import Callable, Sequence

import numpy as np

from controller.manager.leaving import LeavingControllers
from controller.manager.registry import ControllerRegistry, Running
from controller.stops import DecelerationStops
from hal.types import FloatArray, JointState

LOG = logging.getLogger("servoloop.controller")


class ControllerCycle:
    """The cycle runs in the loop's thread, the controllers in the order in which they were loaded."""

    def __init__(
        self, registry: ControllerRegistry, stops: DecelerationStops, fail: Callable[[Running, FloatArray], None]
    ) -> None:
        """``fail`` takes a controller out that has failed; it gets the last command (n,) of all interfaces too."""
        self.seen: JointState | None = None
        """The newest measurement."""
        self.leaving = LeavingControllers(stops)
        self._registry = registry
        self._stops = stops
        self._fail = fail
        self._command = self._last = np.full(len(registry.command_interfaces), np.nan)
        self._period_s = 1.0

    def update(self, state: JointState, last: FloatArray, now_s: float, period_s: float) -> FloatArray:
        """Run one cycle; returns the wanted command (n,). An interface that no controller commands keeps its ``last``.

        A controller that fails is taken out; the others go on. A controller whose joints are still coming to rest
        from the command of another begins when they stand.
        """
        self.seen = state
        wanted = last.copy()
        for entry in self._registry.running:
            if self._stops.moving and self._stops.holds(entry.index):
                continue
            try:
                entry.controller.update(state, now_s, period_s)
                wanted[entry.index] = _shaped(entry)
            except Exception:
                LOG.exception("%s failed and is deactivated: its joints come to rest", entry.spec.name)
                self._fail(entry, last)
        if self.leaving.entries:
            self.leaving.fill(wanted, last, state, now_s, period_s)
        if self._stops.moving:
            self._stops.fill(wanted, period_s)
        self._command, self._last, self._period_s = wanted, last, period_s
        return wanted

    def sent(self, command: FloatArray, last: FloatArray) -> None:
        """The command (n,) as the safety gate has passed it, and the one before: joints come to rest from there."""
        self._command, self._last = command, last

    def settled(self, name: str) -> bool:
        """Whether that controller has settled; for one that is not active there is nothing to wait for."""
        return all(entry.controller.settled() for entry in self._registry.running if entry.spec.name == name)

    def stop(self, index: list[int]) -> None:
        """The interfaces at ``index`` have lost their controller: those in motion come to rest from here."""
        self._stops.begin(index, self._command, (self._command - self._last) / self._period_s)

    def take(self, index: list[int]) -> None:
        """A controller takes the interfaces at ``index``: joints that are being relieved come to rest for it."""
        for ended in self.leaving.end(index):
            self.stop(ended)

    def at_rest(self, index: Sequence[int]) -> bool:
        """Whether no interface at ``index`` is on its way to rest, or to where it presses no more."""
        return not self._stops.holds(index) and not self.leaving.holds(index)


def _shaped(entry: Running) -> FloatArray:
    """A controller's command, which must be one value for each interface: numpy would spread a single one over all."""
    command = entry.controller.command
    if command.shape != (len(entry.index),):
        raise ValueError(f"a command of shape {command.shape} for {len(entry.index)} interfaces")
    return command
