"""Lets faults happen at their times, in the world's own milliseconds."""

from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from heapq import heapify, heappop, heappush
from typing import Final

from sim_backend.faults.errors import FaultError
from sim_backend.faults.event import Event
from sim_backend.faults.targets import Inventory, Since, Targets

ENDS, BEGINS = 0, 1
"""Of what is due at one time, this comes first: a fault that ends makes room for the next."""
ROUNDING_S: Final = 1e-6
"""The world's time is a sum of milliseconds."""


class FaultPlayer:
    """Begins and ends faults. ``update`` belongs behind every step of the world, with the world's time."""

    def __init__(self, targets: Targets) -> None:
        self.active: dict[int, Event] = {}
        """The faults that last now, in the order in which they began."""
        self.happened: list[Event] = []
        """The faults that have begun or ended so far, once for each."""
        self.targets = targets
        """What the faults are done to."""
        self._due: list[tuple[float, int, int, Event]] = []
        self._waiting: list[Event] = []
        """Events whose times count from a moment that is still to come."""
        self._reached: set[Since] = set()
        self._running: dict[int, ExitStack] = {}
        self._number = 0

    def play(self, events: Iterable[Event], since_s: float = 0.0) -> None:
        """Let ``events`` happen to what is up already; their times count from ``since_s`` of the world.

        Those since the program's end wait for it. Raises FaultError, which lists all that cannot be done here; then
        none of them will be.
        """
        events = tuple(events)
        over: list[Since] = ["start", "end"] if "end" in self._reached else ["start"]
        self._require(events, over)
        for event in events:
            if event.since == "up":
                self._put(event, since_s)
            else:
                self._waiting.append(event)

    def plan(self, events: Iterable[Event]) -> None:
        """Let ``events`` happen, each in its time since the moment that it names, which ``reach`` tells.

        Raises FaultError, which lists all that cannot be done here; then none of them will be.
        """
        events = tuple(events)
        self._require(events, self._reached)
        self._waiting += events

    def reach(self, moment: Since, time_s: float) -> None:
        """The stack starts, is up, or begins to end, at ``time_s`` of the world."""
        self._reached.add(moment)
        for event in self._waiting:
            if event.since == moment:
                self._put(event, time_s)
        self._waiting = [event for event in self._waiting if event.since != moment]
        self.begin_due(time_s)

    def _require(self, events: tuple[Event, ...], over: Collection[Since]) -> None:
        """Raise FaultError where an event cannot happen here, or counts from a moment that is over."""
        require_possible(events, self.targets.inventory)
        if late := [event for event in events if event.since in over]:
            texts = (f"{one.kind} at {one.at_s:g} s since {one.since}: that moment is over" for one in late)
            raise FaultError("\n".join(texts))

    def _put(self, event: Event, since_s: float) -> None:
        self._number += 1
        heappush(self._due, (since_s + event.at_s, BEGINS, self._number, event))

    def update(self, time_s: float) -> None:
        """The world has reached ``time_s``."""
        if self._due:
            self.begin_due(time_s)
        self.targets.step(time_s)

    def begin_due(self, time_s: float) -> None:
        """Begin and end what is due."""
        while self._due and self._due[0][0] <= time_s + ROUNDING_S:
            at_s, order, number, event = heappop(self._due)
            if order == BEGINS:
                self._begin(number, event, at_s)
            else:
                self._end(number)

    @property
    def coming(self) -> list[Event]:
        """The faults that have not begun yet, in the order in which they will."""
        due = [event for _, order, _, event in sorted(self._due, key=lambda due: due[:3]) if order == BEGINS]
        return due + self._waiting

    def take_back(self, matches: Callable[[Event], bool]) -> list[Event]:
        """End the active faults that match, the last to have begun first, and forget those to come; returns all."""
        running = [number for number, event in self.active.items() if matches(event)]
        events = [self.active[number] for number in running] + [event for event in self.coming if matches(event)]
        coming = {number for _, order, number, event in self._due if order == BEGINS and matches(event)}
        self._due = [due for due in self._due if due[2] not in {*running, *coming}]
        heapify(self._due)
        self._waiting = [event for event in self._waiting if not matches(event)]
        for number in reversed(running):
            self._end(number)
        return events

    def close(self) -> None:
        """End all faults, the last to have begun first, and forget those to come."""
        self._due.clear()
        self._waiting.clear()
        for number in reversed(list(self._running)):
            self._end(number)

    def _begin(self, number: int, event: Event, at_s: float) -> None:
        self._running[number] = running = ExitStack()
        running.enter_context(event.acting(self.targets))
        self.active[number] = event
        self.happened.append(event)
        if event.lasts_s is not None:
            heappush(self._due, (at_s + event.lasts_s, ENDS, number, event))

    def _end(self, number: int) -> None:
        self.happened.append(self.active.pop(number))
        self._running.pop(number).close()


def require_possible(
    events: Iterable[Event], there: Inventory, place: Callable[[int], str] = lambda number: ""
) -> None:
    """Raise FaultError, with a sentence for each, where some of the events cannot happen to what there is.

    ``place``: the beginning of the sentence about the event of this number.
    """
    wrong = []
    for number, event in enumerate(events):
        try:
            event.refuse(there)
        except FaultError as error:
            since = "" if event.since == "up" else f" since {event.since}"
            wrong.append(f"{place(number)}{event.kind} at {event.at_s:g} s{since}: {error}")
    if wrong:
        raise FaultError("\n".join(wrong))
