"""Distinguish late replies from current replies by their length, because replies do not carry a sequence number.

A request without a reply stays open, because its reply may still arrive. A servo with an open request is asked for a
block of a different size, so that the length shows which request a reply answers. If requests of all sizes are open,
one of the sizes is requested again. A reply of this size is not used, because it may be the old reply. The reply closes
all requests sent before the first request of its size, because a servo replies in order. The next reply is then
unambiguous.

A late reply is therefore never mistaken for the reply to a later request. This holds if the replies of a servo arrive
in order and are delayed by at most ``OPEN_S``. If a later reply of the same servo overtakes a reply, the overtaken
reply is still recognized for ``HELD_S``, unless all sizes are in use.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

OPEN_S: Final = 2.0
"""Maximum time between a request and its late reply, in seconds. Adapters and the operating system's scheduler can
delay bytes."""
HELD_S: Final = 0.25
"""Usual maximum delay of bytes, in seconds. Setup can wait this long."""

Missed = Literal["silent", "corrupt", "late", "refused", "no_time"]
"""Fault type that was counted for a missing reply."""


@dataclass(slots=True)
class _OpenRequests:
    """Open requests to one servo for replies of one size."""

    given_up: deque[tuple[float, Missed]]
    """Time at which each request was abandoned, and the fault type that was counted, oldest first."""
    until_s: float
    """Latest possible arrival time of a reply to the last request."""
    overtaken: bool = False
    """Whether the servo has replied to a later request. In that case, no reply to these requests is expected."""


class LateReplyFilter:
    """Open requests of one bus, keyed by servo and reply size.

    A corrupt reply leaves its request open, because the garbage may come from another servo. A rejection that arrives
    while other requests are open also leaves its request open. A rejection contains no data and may belong to any of
    the open requests.
    """

    def __init__(self) -> None:
        self.open: dict[int, dict[int, _OpenRequests]] = {}
        """Open requests, keyed by servo ID and reply size. Servos without open requests are omitted."""
        self._single_until_s: dict[int, float] = {}

    def add(self, servo_id: int, size: int, now_s: float, counted: Missed) -> None:
        """Record that a servo sent no valid reply to a request for ``size`` bytes of data."""
        of_servo = self.open.setdefault(servo_id, {})
        if size in of_servo and not of_servo[size].overtaken:
            given_up = of_servo[size].given_up
            given_up.append((now_s, counted))
            of_servo[size].until_s = now_s + OPEN_S
            while given_up[0][0] <= now_s - OPEN_S:
                given_up.popleft()
        else:
            of_servo[size] = _OpenRequests(deque(((now_s, counted),)), now_s + OPEN_S)

    def add_single(self, servo_id: int, now_s: float) -> None:
        """Record that a servo sent no valid reply to a single request of any size."""
        self._single_until_s[servo_id] = now_s + HELD_S

    def single_until_s(self, servo_id: int) -> float:
        """Return the time until which a late reply to a single request may arrive, or minus infinity."""
        return self._single_until_s.get(servo_id, -math.inf)

    def match(self, servo_id: int, size: int, asked: bool = False) -> Missed | None:
        """Close the open requests that a reply of this size may answer.

        Return the fault that was counted for the oldest of these requests.

        Return None if the reply does not match an open request. If this size was requested last (``asked``), overtaken
        requests are not considered.
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
        """Record that a servo has definitely replied to the last request.

        Replies to earlier requests are then unlikely to arrive.
        """
        self._single_until_s.pop(servo_id, None)
        for one in self.open.get(servo_id, {}).values():
            if not one.overtaken:
                one.overtaken, one.until_s = True, now_s + HELD_S

    def ambiguous(self, sizes: Mapping[int, int]) -> bool:
        """Return whether a reply of the requested size may answer an earlier request. ``sizes`` is keyed by servo
        ID."""
        asked = (self.open[servo_id].get(sizes[servo_id]) for servo_id in self.open.keys() & sizes)
        return any(one is not None and not one.overtaken for one in asked)

    def servos(self, now_s: float) -> frozenset[int]:
        """Return the servos with open requests, whose rejections may belong to an earlier request."""
        single = (i for i, until_s in self._single_until_s.items() if until_s > now_s)
        return frozenset(self.open).union(single)

    def sizes(self) -> frozenset[int]:
        return frozenset(size for of_servo in self.open.values() for size in of_servo)

    def forget(self, now_s: float) -> None:
        for servo_id, of_servo in tuple(self.open.items()):
            self._keep(servo_id, {s: o for s, o in of_servo.items() if o.until_s > now_s})

    def place(self, sizes: Mapping[int, Sequence[int]]) -> int:
        """Return the index into ``sizes`` for which the fewest servos have open requests."""

        # If several sizes are equally good, the one requested last is best, because its reply closes the most requests.
        def open_requests(place: int) -> tuple[int, int, float]:
            found = [o for i, of in sizes.items() if (o := self.open.get(i, {}).get(of[place]))]
            first_s = [one.given_up[0][0] for one in found if not one.overtaken]
            return len(first_s), len(found), -min(first_s, default=0.0)

        return min(range(min(map(len, sizes.values()), default=1)), key=open_requests)

    def _keep(self, servo_id: int, of_servo: dict[int, _OpenRequests]) -> None:
        if of_servo:
            self.open[servo_id] = of_servo
        else:
            self.open.pop(servo_id, None)
