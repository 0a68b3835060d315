"""Count the loop's cycles, missed cycles and cycles without a measurement."""

import logging
import math
from dataclasses import dataclass, field

from controller.missed_cycles import REPORT_AGAIN_S, CycleTimes, MissedCycles
from drivers.printable import counted
from hal.components.component_set import ComponentSet
from hal.fault_timeout import FAULT_CYCLES
from hal.types import JointState

LOG = logging.getLogger("servoloop.controller")


@dataclass(slots=True)
class LoopFigures:
    """Statistics since the loop started. A cycle counts as missed if it is due while the previous cycle is still
    running."""

    cycles: int = 0
    missed: int = 0
    unmeasured: int = 0
    """Number of cycles in which no joint was measured. These cycles do not count as on time."""
    latest_wake_up_s: float = 0.0
    longest_cycle_s: float = 0.0
    busy_s: float = 0.0
    last_late_s: float = 0.0
    """Delay at the start of the last cycle, in seconds."""
    last_busy_s: float = 0.0
    """Duration of the last cycle, in seconds."""
    observer_errors: int = 0
    unmeasured_in_a_row: int = 0
    last_read_s: float = 0.0
    """Duration of the last read, in seconds."""
    _return_logged_s: float = -math.inf
    """Time of the last log message stating that joints are measured again, in seconds."""
    _unlogged_returns: int = 0
    """Number of episodes without a measurement that have ended since the last such log message."""
    recent: MissedCycles = field(default_factory=MissedCycles, compare=False)
    """Missed cycles since the last report, and the highest rate sustained in recent cycles."""

    @property
    def summary(self) -> str:
        """String with the number of missed cycles and of cycles without a measurement."""
        parts = [f"{counted(self.missed, 'cycle')} missed"] if self.missed else []
        parts += [f"{counted(self.unmeasured, 'cycle')} without a measurement"] if self.unmeasured else []
        return ", ".join(parts) or "every cycle on time"

    def count_cycle(self, due_s: float, woke_s: float, now_s: float, period_s: float, computed_s: float) -> float:
        """Count a cycle and return the time at which the next cycle is due.

        Missed cycles are skipped with a warning and never executed in a burst, as with ros2_control's
        ``overruns.manage: true``.

        Args:
            due_s: Time at which the cycle was due, in seconds.
            woke_s: Time at which the cycle started, in seconds.
            now_s: Time at which the cycle ended, in seconds.
            period_s: Period of the loop, in seconds.
            computed_s: Processor time of the cycle, in seconds. The processor time of the read may be included.
        """
        late_s, busy_s = woke_s - due_s, now_s - woke_s
        self.cycles += 1
        self.last_late_s, self.last_busy_s = late_s, busy_s
        self.latest_wake_up_s = max(self.latest_wake_up_s, late_s)
        self.longest_cycle_s = max(self.longest_cycle_s, busy_s)
        self.busy_s += busy_s
        self.recent.add(late_s + busy_s)
        missed = int((late_s + busy_s) / period_s)
        if missed:
            self.missed += missed
            after_read_s = max(busy_s - self.last_read_s, 0.0)
            computing_s = min(computed_s, after_read_s)
            self.recent.miss(missed, CycleTimes(late_s + after_read_s - computing_s, self.last_read_s, computing_s))
        if report := self.recent.report(now_s, period_s):
            LOG.warning("%s", report)
        return due_s + (1 + missed) * period_s

    def count_unmeasured(self, state: JointState, hardware: ComponentSet) -> None:
        """Count a cycle in which no joint was measured although at least one component could have been read.

        The hardware logs the individual faults. This method logs when an episode lasts a long time and when it ends.
        """
        asked = hardware.failures or any(component.sound for component in hardware.components)
        if asked and sum(fault.kind != "no_torque" for fault in state.faults.values()) == len(hardware.joints):
            self.unmeasured += 1
            self.unmeasured_in_a_row += 1
            if self.unmeasured_in_a_row == FAULT_CYCLES:
                why = next(iter(state.faults.values())).text
                LOG.warning("no joint has been measured for %d cycles: %s", FAULT_CYCLES, why)
        elif asked and self.unmeasured_in_a_row:
            self._log_return(state.stamp_s)

    def _log_return(self, now_s: float) -> None:
        """Log that joints are measured again, at most once per second."""
        self._unlogged_returns += 1
        if now_s - self._return_logged_s >= REPORT_AGAIN_S:
            cycles, more = counted(self.unmeasured_in_a_row, "cycle"), self._unlogged_returns - 1
            before = f" ({counted(more, 'earlier episode')} not logged)" if more else ""
            LOG.warning("joint measurements have resumed after %s without a measurement%s", cycles, before)
            self._return_logged_s, self._unlogged_returns = now_s, 0
        self.unmeasured_in_a_row = 0
