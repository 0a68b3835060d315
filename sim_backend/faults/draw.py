"""Draw random fault schedules before a run. Each fault type has its own sequence of random numbers.

Start times are uniform. Durations, delays, probabilities and sizes follow a log-uniform distribution
(``sim_backend.faults.tails``).
"""

from collections.abc import Collection, Iterator
from random import Random
from typing import Final

from sim_backend.faults.event import Event
from sim_backend.faults.events import KINDS
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.targets import Inventory, Since

AT_THE_START: Final = 1 / 6
"""Fraction of the faults whose times are relative to the start of the stack."""
AT_THE_END: Final = 1 / 6
"""Fraction of the faults whose times are relative to the moment when the program begins to exit."""
TRIES: Final = 200
"""Number of draws after which a fault type is considered impossible."""


def draw(
    seed: int | str, there: Inventory, seconds: float, how_many: int, kinds: Collection[str] | None = None
) -> tuple[Event, ...]:
    """Draw ``how_many`` random faults over the entire life of a stack, in chronological order.

    By default, all fault types are drawn; ``kinds`` limits the types. If a fault starts while the arm is up, it starts
    within ``seconds``.

    Random bids for each fault type are drawn from a separate sequence, and the events with the lowest bids are used.
    The draws of one type therefore do not change the events of another type; an additional type can only displace some
    of them. A type with a ``WEIGHT`` above 1 gets lower bids, so it is drawn more often.
    """
    for name in kinds or ():
        if name not in KINDS:
            raise FaultError(f"there is no fault {name!r}; known faults: {', '.join(KINDS)}")
    chosen = [name for name in KINDS if kinds is None or name in kinds]
    bids = sorted((bid for name in chosen for bid in _bids(seed, name, there, seconds, how_many)), key=lambda b: b[:3])
    drawn = (bid[-1] for bid in bids[:how_many])
    return tuple(sorted(drawn, key=lambda event: (there.moments.index(event.since), event.at_s)))


def impossible(kind: str, there: Inventory) -> str:
    """Return the reason why no target in the inventory can have a fault of this type, or an empty string if the fault
    is possible."""
    why = ""
    for number in range(TRIES):
        try:
            KINDS[kind].drawn(Random(f"{kind}/{number}"), there, 0.0)
        except FaultError as error:
            why = str(error)
        else:
            return ""
    return why


def _bids(
    seed: int | str, kind: str, there: Inventory, seconds: float, how_many: int
) -> Iterator[tuple[float, str, int, Event]]:
    """Yield the events of one fault type, each with its bid. At most as many events are drawn as can be used. Yield
    nothing if this fault type is impossible."""
    random = Random(f"{seed}/{kind}")
    for number in range(how_many):
        # Each event has its own random stream, so that an additional draw within one event does not change other
        # events.
        own = Random(random.getrandbits(64))
        bid = min(own.random() for _ in range(KINDS[kind].WEIGHT))
        since, at_s = _moment(own, there, seconds)
        try:
            yield bid, kind, number, KINDS[kind].drawn(own, there, at_s, since)
        except FaultError:
            continue


def _moment(random: Random, there: Inventory, seconds: float) -> tuple[Since, float]:
    """Draw the time of a fault in seconds, and the moment to which this time is relative."""
    share = random.random()
    since: Since = "start" if share < AT_THE_START else "end" if share < AT_THE_START + AT_THE_END else "up"
    if since not in there.moments:
        since = "up"
    lasts_s = {"start": there.start_s, "up": seconds, "end": there.end_s}[since]
    return since, round(random.uniform(0.0, lasts_s or 0.0), 3)
