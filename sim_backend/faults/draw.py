"""Random schedules of faults, all drawn before anything happens, each kind from a stream of its own.

Moments are drawn uniformly. Durations, delays, chances and sizes are log-uniform (``sim_backend.faults.tails``).
"""

from collections.abc import Collection, Iterator
from random import Random
from typing import Final

from sim_backend.faults.errors import FaultError
from sim_backend.faults.event import Event
from sim_backend.faults.events import KINDS
from sim_backend.faults.targets import Inventory, Since

AT_THE_START: Final = 1 / 6
"""Share of the faults whose time counts from the start of the stack."""
AT_THE_END: Final = 1 / 6
"""Share of the faults whose time counts from the beginning of the program's end."""
TRIES: Final = 200
"""Number of draws after which nothing is taken to have a fault."""


def draw(
    seed: int | str, there: Inventory, seconds: float, how_many: int, kinds: Collection[str] | None = None
) -> tuple[Event, ...]:
    """``how_many`` random faults over the whole life of a stack, by time; of all kinds, or of ``kinds``.

    Those that begin while the arm is up do so within ``seconds``.

    Each kind bids for places with numbers from its own stream of the seed, and the lowest bids win. So what one kind
    draws changes nothing of what another does; a kind more can only take places.
    """
    for name in kinds or ():
        if name not in KINDS:
            raise FaultError(f"there is no fault {name!r}: known are {', '.join(KINDS)}")
    chosen = [name for name in KINDS if kinds is None or name in kinds]
    bids = sorted((bid for name in chosen for bid in _bids(seed, name, there, seconds, how_many)), key=lambda b: b[:3])
    drawn = (bid[-1] for bid in bids[:how_many])
    return tuple(sorted(drawn, key=lambda event: (there.moments.index(event.since), event.at_s)))


def impossible(kind: str, there: Inventory) -> str:
    """Return why nothing there can have a fault of this kind, in a sentence; an empty text if something can."""
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
    """As many events as this kind could get places for, each with its bid; none where nothing there can have it."""
    random = Random(f"{seed}/{kind}")
    for number in range(how_many):
        # A stream for each event: one more number in it changes no other.
        own = Random(random.getrandbits(64))
        bid, (since, at_s) = own.random(), _moment(own, there, seconds)
        try:
            yield bid, kind, number, KINDS[kind].drawn(own, there, at_s, since)
        except FaultError:
            continue


def _moment(random: Random, there: Inventory, seconds: float) -> tuple[Since, float]:
    """When a fault begins: from which moment its time counts, and the time."""
    share = random.random()
    since: Since = "start" if share < AT_THE_START else "end" if share < AT_THE_START + AT_THE_END else "up"
    if since not in there.moments:
        since = "up"
    lasts_s = {"start": there.start_s, "up": seconds, "end": there.end_s}[since]
    return since, round(random.uniform(0.0, lasts_s or 0.0), 3)
