"""Random schedules of faults, all drawn before anything happens, each kind from a stream of its own."""

from collections.abc import Collection, Iterator
from random import Random

from sim_backend.faults.errors import FaultError
from sim_backend.faults.event import Event
from sim_backend.faults.events import KINDS
from sim_backend.faults.targets import Inventory


def draw(
    seed: int | str, there: Inventory, seconds: float, how_many: int, kinds: Collection[str] | None = None
) -> tuple[Event, ...]:
    """``how_many`` random faults within ``seconds``, by time; of all kinds, or of ``kinds``.

    Each kind bids for places with numbers from its own stream of the seed, and the lowest bids win. So what one kind
    draws changes nothing of what another does; a kind more can only take places.
    """
    for name in kinds or ():
        if name not in KINDS:
            raise FaultError(f"there is no fault {name!r}: known are {', '.join(KINDS)}")
    chosen = [name for name in KINDS if kinds is None or name in kinds]
    bids = sorted((bid for name in chosen for bid in _bids(seed, name, there, seconds, how_many)), key=lambda b: b[:3])
    return tuple(sorted((bid[-1] for bid in bids[:how_many]), key=lambda event: event.at_s))


def _bids(
    seed: int | str, kind: str, there: Inventory, seconds: float, how_many: int
) -> Iterator[tuple[float, str, int, Event]]:
    """As many events as this kind could get places for, each with its bid; none where nothing there can have it."""
    random = Random(f"{seed}/{kind}")
    for number in range(how_many):
        # A stream for each event: one more number in it changes no other.
        own = Random(random.getrandbits(64))
        bid, at_s = own.random(), round(own.uniform(0.0, seconds), 3)
        try:
            yield bid, kind, number, KINDS[kind].drawn(own, there, at_s)
        except FaultError:
            continue
