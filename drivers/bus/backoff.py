"""Decide when to send requests to silent servos again.

A request to a silent servo takes the whole timeout. A silent servo is therefore asked last and at growing intervals,
but it is found within a second after it starts to respond again.
"""

from collections.abc import Mapping
from typing import Final

from drivers.bus.read_plan import ReadResult
from drivers.types import ServoFault, ServoState

ASKED_ALWAYS: Final = 2
"""Maximum number of consecutive misses after which a servo is still asked in every cycle, because single replies may be
lost.
"""
FIRST_PAUSE_S: Final = 0.02
LONGEST_PAUSE_S: Final = 0.4


class Backoff:
    """The silent servos of one bus and the order in which to ask them."""

    def __init__(self) -> None:
        self.misses: dict[int, int] = {}
        """Number of consecutive misses of each silent servo."""
        self._next_s: dict[int, float] = {}
        self._queue: list[int] = []

    def note(self, outcome: Mapping[int, ReadResult], now_s: float) -> list[int]:
        """Record which servos replied. Return the servos that did not report a state, with the first of them moved to
        the end.

        In some group reads, each servo waits for the reply of the previous servo, so the first silent servo may hide
        the others.
        """
        missing = [i for i, result in outcome.items() if result.__class__ is not ServoState]
        if not missing and not self.misses and not self._queue:
            return missing
        for servo_id in outcome.keys() - missing:
            self.misses.pop(servo_id, None)
        for servo_id in missing:
            result = outcome[servo_id]
            if result in ("corrupt", "reset") or isinstance(result, ServoFault):
                self.misses.pop(servo_id, None)
            elif result != "no_time":
                self._missed(servo_id, now_s)
                if result == "late":  # the servo is present, and its next reply may be valid
                    self._next_s[servo_id] = now_s
        missing = missing[1:] + missing[:1]
        self._queue = [i for i in self._queue if i not in outcome] + missing
        return missing

    def _missed(self, servo_id: int, now_s: float) -> None:
        misses = self.misses.get(servo_id, 0) + 1
        self.misses[servo_id] = misses
        pause_s = FIRST_PAUSE_S * 2.0 ** min(misses - ASKED_ALWAYS - 1, 8)
        self._next_s[servo_id] = now_s + (min(pause_s, LONGEST_PAUSE_S) if misses > ASKED_ALWAYS else 0.0)

    def split(self, servo_ids: tuple[int, ...], now_s: float) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the responsive servos, and the silent servos that are due to be probed after them."""
        if not self.misses:
            return servo_ids, ()
        responsive = tuple(i for i in servo_ids if i not in self.misses)
        # If all servos are silent, pausing would save no time and would prolong a stall of the bus.
        due = {i for i in servo_ids if i in self.misses and (not responsive or self._next_s[i] <= now_s)}
        return responsive, tuple(i for i in self._queue if i in due)
