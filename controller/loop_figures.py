"""The loop's figures say how well it keeps its time, and in how many cycles it learnt nothing of the joints."""

import logging
import math
from dataclasses import dataclass
from typing import Final

from controller.fault_timeout import FAULT_CYCLES
from drivers.printable import counted
from hal.components.component_set import ComponentSet
from hal.types import JointState

LOG = logging.getLogger("servoloop.controller")

TELL_AGAIN_S: Final = 1.0
"""A loop that misses cycle after cycle says so once in this time: a line for each would make it later still."""


@dataclass(slots=True)
class LoopFigures:
    """Counted since the loop began. A cycle is missed when its time passes before the last one has ended."""

    cycles: int = 0
    missed: int = 0
    unmeasured: int = 0
    """Cycles that came, but in which not one joint was measured: none of them counts as on time."""
    latest_wake_up_s: float = 0.0
    longest_cycle_s: float = 0.0
    busy_s: float = 0.0
    last_late_s: float = 0.0
    """How late the last cycle woke up, and below how long it took."""
    last_busy_s: float = 0.0
    observer_errors: int = 0
    unmeasured_in_a_row: int = 0
    _told_s: float = -math.inf
    _told: int = 0
    """When missed cycles were told last, how many at a time were, and how many more were missed since."""
    _untold: int = 0

    @property
    def summary(self) -> str:
        """The cycles that were not as they should be, in words."""
        told = [f"{counted(self.missed, 'cycle')} missed"] if self.missed else []
        told += [f"{counted(self.unmeasured, 'cycle')} without a measurement"] if self.unmeasured else []
        return ", ".join(told) or "every cycle on time"

    def count_cycle(self, due_s: float, woke_s: float, now_s: float, period_s: float) -> float:
        """Count the cycle that was due at ``due_s``, woke up at ``woke_s`` and ends now; returns when the next is due.

        This is upstream's ``overruns.manage: true``, and there is no other way here: what was due meanwhile is
        skipped with a warning, never made up for in a burst.
        """
        late_s, busy_s = woke_s - due_s, now_s - woke_s
        self.cycles += 1
        self.last_late_s, self.last_busy_s = late_s, busy_s
        self.latest_wake_up_s = max(self.latest_wake_up_s, late_s)
        self.longest_cycle_s = max(self.longest_cycle_s, busy_s)
        self.busy_s += busy_s
        missed = int((late_s + busy_s) / period_s)
        if missed:
            self.missed += missed
            self._tell(missed, now_s)
        return due_s + (1 + missed) * period_s

    def _tell(self, missed: int, now_s: float) -> None:
        """Log it, unless there was a line just now of a stall that was no shorter."""
        if now_s - self._told_s < TELL_AGAIN_S and missed <= self._told:
            self._untold += missed
            return
        before = f" ({self._untold} more since the last such line)" if self._untold else ""
        late_ms, busy_ms = self.last_late_s * 1e3, self.last_busy_s * 1e3
        LOG.warning(
            "missed %s: the loop was %.0f ms late, busy %.0f ms%s", counted(missed, "cycle"), late_ms, busy_ms, before
        )
        self._told_s, self._told, self._untold = now_s, missed, 0

    def look_for_measurements(self, state: JointState, hardware: ComponentSet) -> None:
        """A cycle in which every joint has a fault measured nothing, unless no component is there to be asked.

        The hardware reports the fault itself. The log has an episode that lasts, and every episode's end.
        """
        asked = hardware.failures or any(component.sound for component in hardware.components)
        if asked and sum(fault.kind != "no_torque" for fault in state.faults.values()) == len(hardware.joints):
            self.unmeasured += 1
            self.unmeasured_in_a_row += 1
            if self.unmeasured_in_a_row == FAULT_CYCLES:
                why = next(iter(state.faults.values())).text
                LOG.warning("no joint has been measured for %d cycles: %s", FAULT_CYCLES, why)
        elif asked and self.unmeasured_in_a_row:
            LOG.warning(
                "joints are measured again, after %s without a measurement", counted(self.unmeasured_in_a_row, "cycle")
            )
            self.unmeasured_in_a_row = 0
