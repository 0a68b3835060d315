"""Telling a late reply from a present one: a reply carries no number, but it has a length.

Who still owes an answer is asked for a block of another size; the answer to the old request is then
known by its length, whenever it comes.
"""

from collections.abc import Iterable
from typing import Final

from drivers.bus import FaultKind
from drivers.feetech.state import STATE_SIZE

SIZES: Final = (STATE_SIZE, STATE_SIZE + 2, STATE_SIZE + 5, STATE_SIZE + 7)
"""All begin with the state block and end within the table. Their length bytes differ in two bits at
least: no single flipped bit turns one into another."""
OWED_S: Final = 0.25
"""How long a reply may still come: adapters and schedulers hold bytes back, but not for ever."""


class OwedReplies:
    """Replies that were asked for and have not come."""

    def __init__(self) -> None:
        self._until_s: dict[tuple[int, int], float] = {}
        self._kinds: dict[tuple[int, int], FaultKind] = {}

    def __bool__(self) -> bool:
        """Whether anything is owed."""
        return bool(self._until_s)

    def owe(self, servo_id: int, size: int, now_s: float, kind: FaultKind) -> None:
        """The servo gave no good answer to a request for ``size`` bytes, and that was counted as ``kind``.

        A corrupt one too: the garbage may have been somebody else's, and its own answer yet to come.
        """
        self._until_s[servo_id, size] = now_s + OWED_S
        self._kinds[servo_id, size] = kind

    def settle(self, servo_id: int, size: int) -> FaultKind | None:
        """A reply of this size came: what its absence was counted as, None if it was not owed."""
        if self._until_s.pop((servo_id, size), None) is None:
            return None
        return self._kinds.pop((servo_id, size))

    def sizes(self) -> frozenset[int]:
        """The sizes of all replies that may still come."""
        return frozenset(size for _, size in self._until_s)

    def free_size(self, servo_ids: Iterable[int], now_s: float) -> int:
        """A size that none of them owes; where all are owed, the one that was owed first."""
        self._until_s = {key: until_s for key, until_s in self._until_s.items() if until_s > now_s}
        asked = set(servo_ids)
        owed = {
            size: max((u for (i, s), u in self._until_s.items() if s == size and i in asked), default=0.0)
            for size in SIZES
        }
        return min(SIZES, key=lambda size: owed[size])
