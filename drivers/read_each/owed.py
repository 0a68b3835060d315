"""Telling a late reply from a present one by its length, as ``drivers.feetech.owed`` does for its own sizes."""

from collections.abc import Iterable, Sequence
from typing import Final, Literal

Missed = Literal["silent", "corrupt"]
"""As what a missing reply was counted."""

OWED_S: Final = 0.25
"""How long a reply may still come: adapters and schedulers hold bytes back, but not for ever."""


class OwedSizes:
    """Replies that were asked for and have not come. ``sizes``: what may be asked for, the usual one first."""

    def __init__(self, sizes: Sequence[int]) -> None:
        self._sizes = tuple(sizes)
        self._owed: dict[tuple[int, int], tuple[float, Missed]] = {}

    def owe(self, servo_id: int, size: int, now_s: float, counted: Missed) -> None:
        """The servo did not answer a request for ``size`` bytes."""
        self._owed[servo_id, size] = now_s + OWED_S, counted

    def settle(self, servo_id: int, size: int) -> Missed | None:
        """A reply of this size came. If it was owed: as what it was counted."""
        _, counted = self._owed.pop((servo_id, size), (0.0, None))
        return counted

    def sizes(self) -> frozenset[int]:
        """The sizes of all replies that may still come."""
        return frozenset(size for _, size in self._owed)

    def free_size(self, servo_ids: Iterable[int], now_s: float) -> int:
        """A size that none of them owes; where all are owed, the one that was owed first."""
        if not self._owed:
            return self._sizes[0]
        self._owed = {key: owed for key, owed in self._owed.items() if owed[0] > now_s}
        asked = set(servo_ids)
        until_s = dict.fromkeys(self._sizes, 0.0)
        for (servo_id, size), (end_s, _) in self._owed.items():
            if servo_id in asked:
                until_s[size] = max(until_s[size], end_s)
        return min(self._sizes, key=lambda size: until_s[size])
