"""Run deactivated controllers that are still relieving their joints, until another controller claims these joints."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

from controller.interface import Relieving
from controller.stops import DecelerationStops
from hal.types import FloatArray, JointState

LOG = logging.getLogger("servoloop.controller")


@dataclass(slots=True)
class _Leaving:
    """A deactivated controller. ``index`` contains the indices of the controller's command interfaces."""

    controller: Relieving
    index: list[int]
    begun: bool = False


class LeavingControllers:
    """Deactivated controllers that are relieving their joints. The loop starts the relief when the controller's joints
    are at rest."""

    def __init__(self, stops: DecelerationStops) -> None:
        self.entries: list[_Leaving] = []
        """Controllers that are currently relieving their joints. While this list is empty, the cycle does not call any
        method of this class."""
        self._stops = stops

    def add(self, controller: Relieving, index: list[int]) -> None:
        """Add a controller that has been deactivated. The relief starts when the controller's joints are at rest."""
        self.entries.append(_Leaving(controller, index))

    def holds(self, index: Sequence[int]) -> bool:
        """Return whether any of the interfaces at ``index`` is still being relieved."""
        return any(i in entry.index for entry in self.entries for i in index)

    def end(self, index: Sequence[int]) -> list[list[int]]:
        """End every relief that uses an interface at ``index``, because a controller is claiming that interface.

        Returns the indices of all interfaces whose relief has ended.
        """
        ended = [entry for entry in self.entries if any(i in entry.index for i in index)]
        self.entries = [entry for entry in self.entries if entry not in ended]
        return [entry.index for entry in ended]

    def restart(self, index: Sequence[int]) -> None:
        """Restart each relief that uses an interface at ``index``, because a different command has moved the joints."""
        for entry in self.entries:
            entry.begun = entry.begun and not any(i in entry.index for i in index)

    def fill(self, wanted: FloatArray, last: FloatArray, state: JointState, now_s: float, period_s: float) -> None:
        """Set the commands of relieved joints in ``wanted`` (n,). ``last`` (n,) is the last command."""
        for entry in tuple(self.entries):
            if self._stops.moving and self._stops.holds(entry.index):
                continue
            try:
                if not entry.begun:
                    entry.begun = True
                    entry.controller.begin_relief(state, last[entry.index])
                goes_on = entry.controller.relieve(state, now_s, period_s)
                wanted[entry.index] = entry.controller.command
            except Exception:
                LOG.exception("%s cannot relieve its joints: they hold their position", entry.controller.name)
                goes_on = False
            if not goes_on:
                self.entries.remove(entry)
