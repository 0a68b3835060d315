"""Count cycles of the loop, missed cycles and cycles without a measurement."""

import logging
import math
from dataclasses import dataclass
from typing import Final

from drivers.printable import counted
from hal.components.component_set import ComponentSet
from hal.fault_timeout import FAULT_CYCLES
from hal.types import JointState

LOG = logging.getLogger("servoloop.controller")

WARN_AGAIN_S: Final = 1.0
"""Minimum time between two warnings about missed cycles, in seconds. More warnings would make the loop even later."""


@dataclass(slots=True)
class LoopFigures:
    """Figures since the loop started. A cycle is missed if the cycle before it ends after its due time."""

    cycles: int = 0
    missed: int = 0
    unmeasured: int = 0
    """Number of cycles in which no joint was measured. These cycles do not count as on time."""
    latest_wake_up_s: float = 0.0
    longest_cycle_s: float = 0.0
    busy_s: float = 0.0
    last_late_s: float = 0.0
    """Delay with which the last cycle started, in seconds."""
    last_busy_s: float = 0.0
    """Duration of the last cycle, in seconds."""
    observer_errors: int = 0
    unmeasured_in_a_row: int = 0
    _warned_s: float = -math.inf
    """Time of the last warning about missed cycles."""
    _warned: int = 0
    """Number of missed cycles in the last warning."""
    _unreported: int = 0
    """Number of cycles missed since the last warning."""

    @property
    def summary(self) -> str:
        """The number of missed cycles and of cycles without a measurement, as a text."""
        parts = [f"{counted(self.missed, 'cycle')} missed"] if self.missed else []
        parts += [f"{counted(self.unmeasured, 'cycle')} without a measurement"] if self.unmeasured else []
        return ", ".join(parts) or "every cycle on time"

    def count_cycle(self, due_s: float, woke_s: float, now_s: float, period_s: float) -> float:
        """Count a cycle that was due at ``due_s``, started at ``woke_s`` and ends at ``now_s``.

        Returns the time at which the next cycle is due. Missed cycles are skipped with a warning, never run in a
        burst, as with ros2_control's ``overruns.manage: true``.
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
            self._warn(missed, now_s)
        return due_s + (1 + missed) * period_s

    def _warn(self, missed: int, now_s: float) -> None:
        """Log missed cycles, unless a recent warning reported a stall of at least the same length."""
        if now_s - self._warned_s < WARN_AGAIN_S and missed <= self._warned:
            self._unreported += missed
            return
        before = f" ({self._unreported} more since the last warning)" if self._unreported else ""
        late_ms, busy_ms = self.last_late_s * 1e3, self.last_busy_s * 1e3
        LOG.warning(
            "missed %s: the loop was %.0f ms late, busy %.0f ms%s", counted(missed, "cycle"), late_ms, busy_ms, before
        )
        self._warned_s, self._warned, self._unreported = now_s, missed, 0

    def count_unmeasured(self, state: JointState, hardware: ComponentSet) -> None:
        """Count a cycle in which no joint was measured, if at least one component could have been read.

        The hardware logs the faults themselves. This method logs that an episode lasts, and the end of each episode.
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
                "joints are measured again after %s without a measurement", counted(self.unmeasured_in_a_row, "cycle")
            )
            self.unmeasured_in_a_row = 0
