"""Telling a late reply from a present one: a reply carries no number, but it has a length.

Who still owes an answer is asked for a block that begins elsewhere; the answer to the old request is
then known by its length, whenever it comes.
"""

from collections.abc import Iterable
from typing import Final

from drivers.dynamixel import x_series

SIZES: Final = tuple(
    x_series.STATE_BLOCK_END - register.address
    for register in (x_series.present_pwm, x_series.moving, x_series.realtime_tick, x_series.goal_position)
)
"""All blocks end with the state. The checksum covers the length: no flipped bit turns one into another."""
OWED_S: Final = 0.25
"""How long a reply may still come: adapters and schedulers hold bytes back, but not for ever."""


class OwedReplies:
    """Replies that were asked for and have not come."""

    def __init__(self) -> None:
        self._until_s: dict[tuple[int, int], float] = {}

    def __bool__(self) -> bool:
        """Whether anything is owed."""
        return bool(self._until_s)

    def owe(self, servo_id: int, size: int, now_s: float) -> None:
        """The servo did not answer a request for ``size`` bytes."""
        self._until_s[servo_id, size] = now_s + OWED_S

    def settle(self, servo_id: int, size: int) -> bool:
        """A reply of this size came; whether it was owed."""
        return self._until_s.pop((servo_id, size), None) is not None

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
