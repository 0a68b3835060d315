"""Update all active controllers one after another, and combine their commands."""

import logging
from collections.abc import Callable, Sequence

import numpy as np

from controller.manager.leaving import LeavingControllers
from controller.manager.registry import ActiveEntry, ControllerRegistry
from controller.stops import DecelerationStops
from hal.types import FloatArray, JointState

LOG = logging.getLogger("servoloop.controller")


class ControllerCycle:
    """Updater of all active controllers, in the order in which they were loaded. The updates run in the loop thread."""

    def __init__(
        self, registry: ControllerRegistry, stops: DecelerationStops, fail: Callable[[ActiveEntry, FloatArray], None]
    ) -> None:
        """Create the cycle. ``fail`` deactivates a failed controller; its argument is the last command (n,) of all
        interfaces."""
        self.seen: JointState | None = None
        """Latest measurement."""
        self.leaving = LeavingControllers(stops)
        self._registry = registry
        self._stops = stops
        self._fail = fail
        self._command = self._last = np.full(len(registry.command_interfaces), np.nan)
        self._period_s = 1.0

    def update(self, state: JointState, last: FloatArray, now_s: float, period_s: float) -> FloatArray:
        """Run one cycle and return the command (n,) of all interfaces.

        An interface without a controller keeps its ``last`` command. A controller that fails is deactivated, and the
        other controllers continue. If a controller's joints are still stopping after another controller's motion, the
        controller starts when they are at rest.
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
                LOG.exception("%s failed and is being deactivated: its joints are brought to rest", entry.spec.name)
                self._fail(entry, last)
        if self.leaving.entries:
            self.leaving.fill(wanted, last, state, now_s, period_s)
        if self._stops.moving:
            self._stops.fill(wanted, period_s)
        self._command, self._last, self._period_s = wanted, last, period_s
        return wanted

    def sent(self, command: FloatArray, last: FloatArray) -> None:
        """Record the last two commands (n,) that passed the safety gate.

        Joints that lose their controller start to stop from these commands.
        """
        self._command, self._last = command, last

    def settled(self, name: str) -> bool:
        """Return whether a controller has settled. An inactive controller counts as settled."""
        return all(entry.controller.settled() for entry in self._registry.running if entry.spec.name == name)

    def stop(self, index: list[int]) -> None:
        """Stop the joints of the interfaces at ``index``, which have lost their controller."""
        self._stops.begin(index, self._command, (self._command - self._last) / self._period_s)

    def take(self, index: list[int]) -> None:
        """End each relief that uses an interface at ``index``, because a controller is claiming this interface.

        The joints whose relief has ended first come to rest.
        """
        for ended in self.leaving.end(index):
            self.stop(ended)

    def at_rest(self, index: Sequence[int]) -> bool:
        """Return whether none of the interfaces at ``index`` is being stopped or relieved."""
        return not self._stops.holds(index) and not self.leaving.holds(index)


def _shaped(entry: ActiveEntry) -> FloatArray:
    """Return a controller's command after checking its shape. numpy would broadcast a single value."""
    command = entry.controller.command
    if command.shape != (len(entry.index),):
        raise ValueError(f"the command has shape {command.shape}, expected ({len(entry.index)},)")
    return command
