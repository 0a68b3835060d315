"""Start and end faults on time, synchronized with the time steps of the simulated world."""

from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from heapq import heapify, heappop, heappush
from typing import Final

from sim_backend.faults.event import Event
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.targets import FaultTargets, Inventory, Since

ENDS, BEGINS = 0, 1
"""Order of events that are due at the same time. A fault ends before the next fault begins."""
ROUNDING_S: Final = 1e-6
"""Tolerance for times, in seconds. The world's time is a sum of milliseconds, which causes rounding errors."""


class FaultPlayer:
    """Player that starts and ends faults. Call ``update`` with the world's time after each world step."""

    def __init__(self, targets: FaultTargets) -> None:
        self.active: dict[int, Event] = {}
        """Active faults, in the order in which they began."""
        self.happened: list[Event] = []
        """Log of the faults that have begun or ended. A fault that has begun and ended appears twice."""
        self.targets = targets
        """Buses, world, adapters and stack that faults affect."""
        self._due: list[tuple[float, int, int, Event]] = []
        self._waiting: list[Event] = []
        """Events whose times are relative to a moment that has not been reached yet."""
        self._reached: set[Since] = set()
        self._running: dict[int, ExitStack] = {}
        self._number = 0

    def play(self, events: Iterable[Event], since_s: float = 0.0) -> None:
        """Schedule ``events`` for a stack that is already up. The event times are relative to the world time
        ``since_s``.

        Events whose times are relative to the end of the program wait for that moment. Raises FaultError with a list of
        all events that are not supported here; in that case, no event is scheduled.
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
        """Schedule ``events`` for a stack that has not been started yet. Call ``reach`` to report each moment to which
        event times are relative.

        Raises FaultError with a list of all events that are impossible here; in that case, no event is scheduled.
        """
        events = tuple(events)
        self._require(events, self._reached)
        self._waiting += events

    def reach(self, moment: Since, time_s: float) -> None:
        """Report that the stack starts, is up, or begins to exit at the world time ``time_s``."""
        self._reached.add(moment)
        for event in self._waiting:
            if event.since == moment:
                self._put(event, time_s)
        self._waiting = [event for event in self._waiting if event.since != moment]
        self.begin_due(time_s)

    def _require(self, events: tuple[Event, ...], over: Collection[Since]) -> None:
        """Raise FaultError if an event is not supported here, or if its time is relative to a moment that has
        passed."""
        require_possible(events, self.targets.inventory)
        if late := [event for event in events if event.since in over]:
            texts = (f"{one.kind} at {one.at_s:g} s since {one.since}: this time has already passed" for one in late)
            raise FaultError("\n".join(texts))

    def _put(self, event: Event, since_s: float) -> None:
        self._number += 1
        heappush(self._due, (since_s + event.at_s, BEGINS, self._number, event))

    def update(self, time_s: float) -> None:
        """Report that the world has reached the time ``time_s``."""
        if self._due:
            self.begin_due(time_s)
        self.targets.step(time_s)

    def begin_due(self, time_s: float) -> None:
        """Begin and end the faults that are due."""
        while self._due and self._due[0][0] <= time_s + ROUNDING_S:
            at_s, order, number, event = heappop(self._due)
            if order == BEGINS:
                self._begin(number, event, at_s)
            else:
                self._end(number)

    @property
    def coming(self) -> list[Event]:
        """Faults that have not begun yet, in the order in which they will begin."""
        due = [event for _, order, _, event in sorted(self._due, key=lambda due: due[:3]) if order == BEGINS]
        return due + self._waiting

    def cancel(self, matches: Callable[[Event], bool]) -> list[Event]:
        """End all matching active faults, most recent first, and cancel all matching scheduled faults. Return the ended
        and canceled faults."""
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
        """End all active faults, most recent first, and cancel all scheduled faults."""
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
    """Raise FaultError with one sentence for each event that this inventory does not support.

    ``place`` returns the beginning of that sentence for the event with a given index.
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
