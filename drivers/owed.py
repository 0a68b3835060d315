"""Telling a late reply from a present one: a reply carries no number, but it has a length.

Who still owes an answer is asked for a block of another size; the answer to the old request is then
known by its length, whenever it comes.
"""

from collections.abc import Mapping, Sequence
from typing import Final, Literal

OWED_S: Final = 0.25
"""How long a reply may still come: adapters and schedulers hold bytes back, but not for ever."""

Missed = Literal["silent", "corrupt"]
"""As what a missing reply was counted."""


class OwedReplies:
    """Replies that were asked for and have not come.

    A corrupt one is owed too: the garbage may have been somebody else's, and its own answer yet to come.
    """

    def __init__(self) -> None:
        self._owed: dict[tuple[int, int], tuple[float, Missed]] = {}

    def __bool__(self) -> bool:
        """Whether anything is owed."""
        return bool(self._owed)

    def owe(self, servo_id: int, size: int, now_s: float, counted: Missed) -> None:
        """The servo gave no good answer to a request for ``size`` bytes."""
        self._owed[servo_id, size] = now_s + OWED_S, counted

    def settle(self, servo_id: int, size: int) -> Missed | None:
        """A reply of this size came. If it was owed: as what it was counted."""
        _, counted = self._owed.pop((servo_id, size), (0.0, None))
        return counted

    def sizes(self) -> frozenset[int]:
        """The sizes of all replies that may still come."""
        return frozenset(size for _, size in self._owed)

    def forget(self, now_s: float) -> None:
        """What cannot come any more."""
        self._owed = {key: owed for key, owed in self._owed.items() if owed[0] > now_s}

    def free(self, sizes: Mapping[int, Sequence[int]]) -> int:
        """Which of its ``sizes`` to ask each servo for, by their place: one that none of them owes.

        Where all are owed, the one that was owed first.
        """

        def until_s(place: int) -> float:
            return max((self._owed.get((i, of[place]), (0.0, None))[0] for i, of in sizes.items()), default=0.0)

        return min(range(min(map(len, sizes.values()), default=1)), key=until_s)
