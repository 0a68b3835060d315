"""Which servos have stopped answering, and when each is worth asking again.

A silent servo costs a wait. So it is asked last, soon at first and then less and less often, but
often enough to be found within a second of being back.
"""

from collections.abc import Mapping
from typing import Final

from drivers.bus.read_plan import ReadResult
from drivers.bus.types import ServoFault, ServoState

ASKED_ALWAYS: Final = 2
"""Up to this many misses in a row a servo is asked in every cycle: lost replies happen."""
FIRST_PAUSE_S: Final = 0.02
LONGEST_PAUSE_S: Final = 0.4


class Backoff:
    """The servos of one line that are missing: their misses in a row, and the order in which to ask them."""

    def __init__(self) -> None:
        self.misses: dict[int, int] = {}
        """Of those only that are missing."""
        self._next_s: dict[int, float] = {}
        self._queue: list[int] = []

    def note(self, outcome: Mapping[int, ReadResult], now_s: float) -> list[int]:
        """Remember which servos answered, whatever they said, and which did not; returns those that gave no state.

        The first of these may hide the others, where each waits for the one before: it goes to the end.
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
                if result == "late":  # so it is there, and the next answer may be the one to believe
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
        """The responsive servos, and those to probe behind them; the others are not due."""
        if not self.misses:
            return servo_ids, ()
        responsive = tuple(i for i in servo_ids if i not in self.misses)
        # Where nobody answers a pause would be for nobody's sake, and after a stall of the line it would outlast that.
        due = {i for i in servo_ids if i in self.misses and (not responsive or self._next_s[i] <= now_s)}
        return responsive, tuple(i for i in self._queue if i in due)
