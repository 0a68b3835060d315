"""Follow shafts that something pushes over the seam of their encoder, from the last count to 0 or back.

The servo itself counts turns, so such a shaft returns the way it came. Its reading, however, leaps to the other end of
the range. If the stack believed this reading, it would move the goal away from the shaft.
"""

from collections.abc import Collection, Sequence
from typing import Final, NamedTuple

from drivers.servos.angles import shortest
from hal.joint import Joint
from hal.leaps import LONGEST_S

NEAR: Final = 0.125
"""Maximum distance that a shaft moves while it crosses the seam, in turns."""


class _Seen(NamedTuple):
    """Last believed position of a servo."""

    counts: int
    """Counts, beyond the range of the encoder if the shaft has crossed the seam."""
    at_s: float
    """Time of the reading, in seconds."""


class SeamCrossings:
    """Whole turns that the readings of servos lack because their shafts were pushed over the seam of the encoder.

    A second reading must confirm each crossing. A joint whose range contains the seam is not followed, because the
    servo counts its turns in the range.
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        """Follow the joints whose encoders cover a full turn."""
        self._turn = {
            joint.name: joint.model.counts_per_turn
            for joint in joints
            if joint.model.positions is None and not joint.seam_inside
        }
        self._missing = dict.fromkeys(self._turn, 0)
        """Whole turns that the reading of each joint lacks, in counts."""
        self._unconfirmed = dict.fromkeys(self._turn, 0)
        """Change of ``_missing`` according to the latest reading, if not confirmed yet."""
        self._seen: dict[str, _Seen] = {}

    def forget(self, names: Collection[str] | None = None) -> None:
        """Believe the next reading of these joints, or of all joints, within a single turn."""
        for name in self._turn if names is None else names & self._turn.keys():
            self._missing[name] = self._unconfirmed[name] = 0
            self._seen.pop(name, None)

    def counts(self, name: str, reading: int, now_s: float) -> int:
        """Return the counts of a reading, with the whole turns that it lacks."""
        turn = self._turn.get(name)
        if turn is None:
            return reading
        counts, seen = reading + self._missing[name], self._seen.get(name)
        crossed, before = 0, self._unconfirmed[name]
        if seen is not None and now_s - seen.at_s <= LONGEST_S:
            moved = shortest(seen.counts, counts, turn)
            crossed = seen.counts + moved - counts if abs(moved) <= NEAR * turn else 0
        self._unconfirmed[name] = 0 if crossed == before else crossed
        if crossed and crossed == before:
            self._missing[name] += crossed
            return counts + crossed
        return counts

    def believed(self, name: str, counts: int, now_s: float) -> None:
        """Note a position that is plausible."""
        if name in self._turn:
            self._seen[name] = _Seen(counts, now_s)
