"""Telling a late reply from a present one: a reply carries no number, but it has a length.

Who still owes an answer is asked for a block of another size; the answer to the old request is then
known by its length, whenever it comes. There are only a few sizes. Where a servo owes them all it is asked
for one of them once more, and the next reply of that size counts as the late one, whichever it is. It gives
no value, but as a servo's replies come in the order of the questions, it shows that none to an earlier
question is still to come: other sizes are free again, and the next answer is a certain one.

So no reply is ever taken for the answer to a later question, as long as a servo's replies keep their order and
the line holds none back for longer than ``OWED_S``. Beyond that it can happen. Should a reply be overtaken by a
later one of its servo, it is still known within ``OVERTAKEN_S``, unless all sizes are in use.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Final, Literal, NamedTuple

OWED_S: Final = 2.0
"""How long after its question a reply may still come: adapters and schedulers hold bytes back, but not for ever."""
HELD_S: Final = 0.25
"""How long bytes are held back as a rule: for this the set-up can wait."""
OVERTAKEN_S: Final = HELD_S
"""The same where a later question has been answered: then it should not come at all."""

Missed = Literal["silent", "corrupt", "refused"]
"""As what a missing reply was counted."""


class _Owed(NamedTuple):
    """A reply that may still come, or several in a row that are alike: of a bad line there are hundreds."""

    size: int
    until_s: float
    """The last of them."""
    counted: Missed
    times: int = 1
    overtaken: bool = False
    """Whether the servo has answered a later question."""

    def after_answer(self) -> "_Owed":
        if self.overtaken:
            return self
        return self._replace(until_s=self.until_s - OWED_S + OVERTAKEN_S, overtaken=True)


class OwedReplies:
    """Replies that were asked for and have not come.

    A corrupt one is owed too: the garbage may have been somebody else's, and its own answer yet to come. So is one in
    whose place a refusal came while others were owed: that has no length, and may have been the answer to those.
    """

    def __init__(self) -> None:
        self._owed: dict[int, list[_Owed]] = {}  # by servo, in the order of the questions; no empty lists

    def __bool__(self) -> bool:
        """Whether anything is owed."""
        return bool(self._owed)

    def owe(self, servo_id: int, size: int, now_s: float, counted: Missed) -> None:
        """The servo gave no good answer to a request for ``size`` bytes."""
        owed = self._owed.setdefault(servo_id, [])
        one = _Owed(size, now_s + OWED_S, counted)
        if owed and owed[-1] == owed[-1]._replace(size=size, counted=counted, overtaken=False):
            one = one._replace(times=owed.pop().times + 1)
        owed.append(one)

    def settle(self, servo_id: int, size: int, asked: bool) -> Missed | None:
        """A reply of this size came. If it may be one that was owed: as what that was counted.

        The first of this size is taken for it; those before can no longer come. ``asked`` for just now, it is
        not taken for one that was overtaken.
        """
        owed = self._owed.get(servo_id, [])
        for place, one in enumerate(owed, 1):
            if one.size == size and not (asked and one.overtaken):
                rest = [one._replace(times=one.times - 1)] if one.times > 1 else []
                self._keep(servo_id, rest + owed[place:])
                return one.counted
        return None

    def answered(self, servo_ids: Iterable[int]) -> None:
        """They have surely answered the present question: what they owed before should not come any more."""
        if self._owed:
            for servo_id in self._owed.keys() & servo_ids:
                self._owed[servo_id] = [one.after_answer() for one in self._owed[servo_id]]

    def doubtful(self, sizes: Mapping[int, int]) -> bool:
        """Whether a reply of a size that was asked for just now, by servo, may be one that was owed."""
        return any(self._first_s(servo_id, sizes[servo_id]) is not None for servo_id in self._owed.keys() & sizes)

    def servos(self) -> frozenset[int]:
        """Who owes anything."""
        return frozenset(self._owed)

    def sizes(self) -> frozenset[int]:
        """The sizes of all replies that may still come."""
        return frozenset(one.size for one in chain.from_iterable(self._owed.values()))

    def forget(self, now_s: float) -> None:
        """What cannot come any more."""
        for servo_id, owed in tuple(self._owed.items()):
            past = next((place for place, one in enumerate(owed) if one.until_s > now_s), len(owed))
            if past:
                self._keep(servo_id, owed[past:])

    def _keep(self, servo_id: int, owed: list[_Owed]) -> None:
        if owed:
            self._owed[servo_id] = owed
        else:
            del self._owed[servo_id]

    def free(self, sizes: Mapping[int, Sequence[int]]) -> int:
        """Which of its ``sizes`` to ask each servo for, by their place: one that as few as possible of them owe.

        Where several are owed by as many, the one that was owed last: its reply settles the most.
        """

        def doubts(place: int) -> tuple[int, int, float]:
            owing = [(i, of[place]) for i, of in sizes.items() if self._owes(i, of[place])]
            firsts_s = [until_s for one in owing if (until_s := self._first_s(*one)) is not None]
            return len(firsts_s), len(owing), -min(firsts_s, default=0.0)

        return min(range(min(map(len, sizes.values()), default=1)), key=doubts)

    def _owes(self, servo_id: int, size: int) -> bool:
        return any(one.size == size for one in self._owed.get(servo_id, ()))

    def _first_s(self, servo_id: int, size: int) -> float | None:
        """Until when the first reply of this size may come that was not overtaken; None where there is none."""
        owed = self._owed.get(servo_id, ())
        return next((one.until_s for one in owed if one.size == size and not one.overtaken), None)
