"""Telling a late reply from a present one: a reply carries no number, but it has a length.

A question that was not answered stays open: its reply may still come. A servo with an open question is asked for a
block of another size; the reply to the old question is then known by its length, whenever it comes. There are only a
few sizes. Where all are open the servo is asked for one of them once more, and a reply of that size gives no value,
for it may be the old one. But a servo's replies come in the order of the questions, so it closes whatever was asked
before the first question of its size, and the next answer is a certain one.

So no reply is ever taken for the answer to a later question, as long as a servo's replies keep their order and
the line holds none back for longer than ``OPEN_S``. Beyond that it can happen. Should a reply be overtaken by a
later one of its servo, it is still known within ``HELD_S``, unless all sizes are in use.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

OPEN_S: Final = 2.0
"""How long after its question a reply may still come: adapters and schedulers hold bytes back, but not for ever."""
HELD_S: Final = 0.25
"""How long bytes are held back as a rule: for this the set-up can wait."""

Missed = Literal["silent", "corrupt", "late", "refused", "no_time"]
"""As what a missing reply was counted."""


@dataclass(slots=True)
class _Open:
    """The open questions to one servo for replies of one size."""

    given_up: deque[tuple[float, Missed]]
    """When, and as what each was counted, in their order; none that can no longer be answered."""
    until_s: float
    """When the last of them can no longer be answered."""
    overtaken: bool = False
    """Whether the servo has answered a later question: then they should not be answered at all any more."""


class LateReplies:
    """The open questions on one line, by servo and size.

    A corrupt reply leaves its question open too: the garbage may have been somebody else's. So does a refusal that
    came while others were open: that has no length, and may have been the answer to those.
    """

    def __init__(self) -> None:
        self.open: dict[int, dict[int, _Open]] = {}
        """By servo and size; no empty ones."""
        self._single_until_s: dict[int, float] = {}

    def add(self, servo_id: int, size: int, now_s: float, counted: Missed) -> None:
        """The servo gave no good answer to a question for ``size`` bytes of data."""
        of_servo = self.open.setdefault(servo_id, {})
        if size in of_servo and not of_servo[size].overtaken:
            given_up = of_servo[size].given_up
            given_up.append((now_s, counted))
            of_servo[size].until_s = now_s + OPEN_S
            while given_up[0][0] <= now_s - OPEN_S:
                given_up.popleft()
        else:
            of_servo[size] = _Open(deque(((now_s, counted),)), now_s + OPEN_S)

    def add_single(self, servo_id: int, now_s: float) -> None:
        """The servo gave no good answer to a question that it was asked by itself, of whatever size."""
        self._single_until_s[servo_id] = now_s + HELD_S

    def single_until_s(self, servo_id: int) -> float:
        """Until when the answer to such a question may come; minus infinity where there is none."""
        return self._single_until_s.get(servo_id, -math.inf)

    def take(self, servo_id: int, size: int, asked: bool = False) -> Missed | None:
        """A reply of this size came. If it may be one to an open question: as what that was counted.

        Of the size that was ``asked`` for just now it is not taken for one that was overtaken.
        """
        of_servo = self.open.get(servo_id, {})
        one = of_servo.get(size)
        if one is None or (asked and one.overtaken):
            return None
        begin_s, counted = one.given_up.popleft()
        left = {s: o for s, o in of_servo.items() if o.given_up and o.given_up[-1][0] >= begin_s}
        self._keep(servo_id, left)
        return counted

    def answered(self, servo_id: int, now_s: float) -> None:
        """The servo has surely answered the present question: nothing that it was asked before should still come."""
        self._single_until_s.pop(servo_id, None)
        for one in self.open.get(servo_id, {}).values():
            if not one.overtaken:
                one.overtaken, one.until_s = True, now_s + HELD_S

    def doubtful(self, sizes: Mapping[int, int]) -> bool:
        """Whether a reply of the size that was asked for, by servo, may be one to an earlier question."""
        asked = (self.open[servo_id].get(sizes[servo_id]) for servo_id in self.open.keys() & sizes)
        return any(one is not None and not one.overtaken for one in asked)

    def servos(self, now_s: float) -> frozenset[int]:
        """The servos that have open questions: a refusal of theirs may be one to an earlier question."""
        single = (i for i, until_s in self._single_until_s.items() if until_s > now_s)
        return frozenset(self.open).union(single)

    def sizes(self) -> frozenset[int]:
        """The sizes of all replies that may still come."""
        return frozenset(size for of_servo in self.open.values() for size in of_servo)

    def forget(self, now_s: float) -> None:
        """Close the questions whose replies cannot come any more."""
        for servo_id, of_servo in tuple(self.open.items()):
            self._keep(servo_id, {s: o for s, o in of_servo.items() if o.until_s > now_s})

    def place(self, sizes: Mapping[int, Sequence[int]]) -> int:
        """Which of its ``sizes`` to ask each servo for, by their place: one that is open for as few as possible."""

        # Where several are open for as many, the one that was asked for last: its reply closes the most.
        def doubts(place: int) -> tuple[int, int, float]:
            found = [o for i, of in sizes.items() if (o := self.open.get(i, {}).get(of[place]))]
            first_s = [one.given_up[0][0] for one in found if not one.overtaken]
            return len(first_s), len(found), -min(first_s, default=0.0)

        return min(range(min(map(len, sizes.values()), default=1)), key=doubts)

    def _keep(self, servo_id: int, of_servo: dict[int, _Open]) -> None:
        if of_servo:
            self.open[servo_id] = of_servo
        else:
            self.open.pop(servo_id, None)
