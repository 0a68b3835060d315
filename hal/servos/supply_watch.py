"""The watch over the supply: each servo's voltage against the range that its model is rated for."""

import logging
from collections.abc import Sequence
from typing import Final

from drivers.clock import Clock
from drivers.servos.voltage import VoltageFault, usual_range, voltage_fault
from hal.joint import Joint
from hal.servos.fault_log import FaultLog

BEGINS_S: Final = 0.3
"""Minimum time of a wrong voltage before it is reported: a motor that brakes lifts the supply for a moment, one that
starts lowers it."""
ENDS_S: Final = 1.0
"""Minimum time of a right voltage before the report ends: a supply that sags with each motion is one episode."""


class SupplyWatch:
    """The faults of the joints' supplies. An episode is logged once, at its beginning and at its end."""

    def __init__(self, joints: Sequence[Joint], clock: Clock, log: FaultLog) -> None:
        """``log``: where episodes are noted; its owner flushes it at the end of a cycle."""
        self._clock, self._log = clock, log
        self._good = {joint.name: usual_range(joint.model) for joint in joints}
        self._shown: dict[str, VoltageFault] = {}
        self._changed_s: dict[str, tuple[str, float]] = {}
        """By joint: the kind that differs from the one that is shown, and since when."""

    def forget(self) -> None:
        """Forget all episodes."""
        self._shown.clear()
        self._changed_s.clear()

    def look(self, joint: Joint, voltage_v: float, label: str) -> VoltageFault | None:
        """Return what is wrong with the joint's supply, if it lasts. ``label``: the joint's name in a message."""
        lowest, highest = self._good[joint.name]
        shown = self._shown.get(joint.name)
        if shown is None and lowest <= voltage_v <= highest:
            self._changed_s.pop(joint.name, None)
            return None
        found = voltage_fault(joint.model, voltage_v)
        kind = found.kind if found else ""
        if shown is not None and kind == shown.kind and found is not None:
            self._changed_s.pop(joint.name, None)
            self._shown[joint.name] = found  # its text has the newest voltage
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
            text = f"{called} has a right voltage again: {voltage_v:.1f} V"
            self._log.note(logging.WARNING, label, joint.servo_id, text)
