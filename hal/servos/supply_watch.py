"""Check the supply voltage of each servo against the rated range of its model."""

import logging
from collections.abc import Sequence
from typing import Final

from drivers.clock import Clock
from drivers.servos.voltage import VoltageFault, usual_range, voltage_fault
from hal.joint import Joint
from hal.servos.fault_log import FaultLog

BEGINS_S: Final = 0.3
"""Minimum duration of an abnormal voltage before it is reported, in seconds. Motors that brake or start change the
voltage briefly."""
ENDS_S: Final = 1.0
"""Minimum duration of a normal voltage before the report ends, in seconds. A supply that sags during each motion causes
only one report."""


class SupplyWatch:
    """Voltage faults of joints. The start and the end of each episode are logged once."""

    def __init__(self, joints: Sequence[Joint], clock: Clock, log: FaultLog) -> None:
        """Create the check. The owner of ``log`` flushes it at the end of each cycle."""
        self._clock, self._log = clock, log
        self._good = {joint.name: usual_range(joint.model) for joint in joints}
        self._shown: dict[str, VoltageFault] = {}
        self._changed_s: dict[str, tuple[str, float]] = {}
        """Changes that have not been reported yet, keyed by joint name. Each entry holds the new fault type (empty if
        none) and the time of the change.
        """

    def forget(self) -> None:
        """Discard all episodes."""
        self._shown.clear()
        self._changed_s.clear()

    def check(self, joint: Joint, voltage_v: float, label: str) -> VoltageFault | None:
        """Return the voltage fault of a joint once it has lasted ``BEGINS_S``.

        Args:
            joint: The joint.
            voltage_v: Measured voltage.
            label: Name of the joint in messages.
        """
        lowest, highest = self._good[joint.name]
        shown = self._shown.get(joint.name)
        if shown is None and lowest <= voltage_v <= highest:
            self._changed_s.pop(joint.name, None)
            return None
        found = voltage_fault(joint.model, voltage_v)
        kind = found.kind if found else ""
        if shown is not None and kind == shown.kind and found is not None:
            self._changed_s.pop(joint.name, None)
            self._shown[joint.name] = found  # updates the voltage in the message
        elif self._lasts(joint.name, kind, BEGINS_S if found else ENDS_S):
            self._show(joint, found, label, voltage_v)
        return self._shown.get(joint.name)

    def _lasts(self, name: str, kind: str, time_s: float) -> bool:
        now_s, changed = self._clock.now(), self._changed_s.get(name)
        if changed is None or changed[0] != kind:
            changed = self._changed_s[name] = kind, now_s
        return now_s - changed[1] >= time_s

    def _show(self, joint: Joint, found: VoltageFault | None, label: str, voltage_v: float) -> None:
        del self._changed_s[joint.name]
        called = f"{label}: servo {joint.servo_id}"
        if found is not None:
            self._shown[joint.name] = found
            level = logging.ERROR if found.outside else logging.WARNING
            self._log.note(level, label, joint.servo_id, f"{found.kind}: {called} {found.text}")
        elif self._shown.pop(joint.name, None) is not None:
            text = f"{called} has a correct voltage again: {voltage_v:.1f} V"
            self._log.note(logging.WARNING, label, joint.servo_id, text)
