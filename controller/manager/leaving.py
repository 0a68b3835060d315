"""Controllers that have been deactivated and still relieve their joints, until another controller has these."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

from controller.interface import Relieving
from controller.stops import DecelerationStops
from hal.types import FloatArray, JointState

LOG = logging.getLogger("servoloop.controller")


@dataclass(slots=True)
class _Leaving:
    """One of them; ``index``: the places of its commands among the hardware's."""

    controller: Relieving
    index: list[int]
    begun: bool = False


class LeavingControllers:
    """They run in the loop's thread, once their joints have come to rest."""

    def __init__(self, stops: DecelerationStops) -> None:
        self.entries: list[_Leaving] = []
        """Almost always there are none, and then nothing here is called in a cycle."""
        self._stops = stops

    def add(self, controller: Relieving, index: list[int]) -> None:
        """This controller has been deactivated: its joints are relieved where they come to rest."""
        self.entries.append(_Leaving(controller, index))

    def holds(self, index: Sequence[int]) -> bool:
        """Whether any of these is still being relieved."""
        return any(i in one.index for one in self.entries for i in index)

    def end(self, index: Sequence[int]) -> list[list[int]]:
        """A controller takes these: whatever relieves one of them ends. Returns the places of all its commands."""
        ended = [one for one in self.entries if any(i in one.index for i in index)]
        self.entries = [one for one in self.entries if one not in ended]
        return [one.index for one in ended]

    def restart(self) -> None:
        """The joints have been commanded otherwise meanwhile, and rest: they are relieved from where they are."""
        for one in self.entries:
            one.begun = False

    def fill(self, wanted: FloatArray, last: FloatArray, state: JointState, now_s: float, period_s: float) -> None:
        """Their part of ``wanted`` (n,) for the end of the coming period; ``last`` (n,) is the last command."""
        for one in tuple(self.entries):
            if self._stops.moving and self._stops.holds(one.index):
                continue
            try:
                if not one.begun:
                    one.begun = True
                    one.controller.begin_relief(state, last[one.index])
                goes_on = one.controller.relieve(state, now_s, period_s)
                wanted[one.index] = one.controller.command
            except Exception:
                LOG.exception("%s cannot relieve its joints: they stay where they are", one.controller.name)
                goes_on = False
            if not goes_on:
                self.entries.remove(one)
