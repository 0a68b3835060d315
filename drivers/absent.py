"""Which servos have stopped answering, and when each is worth asking again.

A silent servo costs a wait. So it is asked last, soon at first and then less and less often, but
often enough to be found within a second of being back.
"""

from collections.abc import Mapping
from typing import Final

from drivers.bus import ServoFault, ServoState
from drivers.readings import Outcome

ASKED_ALWAYS: Final = 2
"""Up to this many misses in a row a servo is asked in every cycle: lost replies happen."""
FIRST_PAUSE_S: Final = 0.02
LONGEST_PAUSE_S: Final = 0.4


class AbsenceWatch:
    """Misses in a row for each servo."""

    def __init__(self) -> None:
        self.misses: dict[int, int] = {}
        """Of those only that are missing."""
        self._next_s: dict[int, float] = {}

    def note(self, outcome: Mapping[int, Outcome], now_s: float) -> list[int]:
        """Remember who answered, whatever it said, and who did not; returns who has given no state."""
        missing = [i for i, what in outcome.items() if what.__class__ is not ServoState]
        if self.misses:
            for servo_id in outcome.keys() - missing:
                self.misses.pop(servo_id, None)
        for servo_id in missing:
            if outcome[servo_id] in ("corrupt", "reset") or isinstance(outcome[servo_id], ServoFault):
                self.misses.pop(servo_id, None)
            else:
                self.missed(servo_id, now_s)
                if outcome[servo_id] == "late":  # so it is there, and the next answer may be the one to believe
                    self._next_s[servo_id] = now_s
        return missing

    def missed(self, servo_id: int, now_s: float) -> None:
        """It was asked and did not answer."""
        misses = self.misses.get(servo_id, 0) + 1
        self.misses[servo_id] = misses
        pause_s = FIRST_PAUSE_S * 2.0 ** min(misses - ASKED_ALWAYS - 1, 8)
        self._next_s[servo_id] = now_s + (min(pause_s, LONGEST_PAUSE_S) if misses > ASKED_ALWAYS else 0.0)

    def split(self, servo_ids: tuple[int, ...], now_s: float) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Who will surely answer, and who should be tried after them; the others are not due."""
        if not self.misses:
            return servo_ids, ()
        firm = tuple(i for i in servo_ids if i not in self.misses)
        tried = tuple(i for i in servo_ids if i in self.misses and self._next_s[i] <= now_s)
        return firm, tried
