"""The search for who is missing, at other rates, and for who is there beside the robot's servos."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from commissioning.doctor.snapshot import Stranger
from commissioning.scan.scan import scan
from drivers.clock import Clock
from drivers.port import Port
from drivers.servos.catalog import Make


@dataclass(frozen=True, slots=True)
class Found:
    """``bauds``: rates of missing servos, by ID."""

    bauds: Mapping[int, int] = field(default_factory=dict)
    strangers: tuple[Stranger, ...] = ()


Search = Callable[[Port, Clock, Make, Sequence[int], Sequence[int]], Found]
"""Is given the port, the clock, the make, the IDs that are missing and all IDs of the robot."""


def search_line(port: Port, clock: Clock, make: Make, missing: Sequence[int], known: Sequence[int]) -> Found:
    """Look at all rates of the make for the missing ones, and at the port's own for strangers. Raises PortLost."""
    former = port.baud
    elsewhere = scan(port, clock, servo_ids=missing, makes=(make,)).servos if missing else ()
    here = scan(port, clock, bauds=(former,), makes=(make,)).servos
    strangers = tuple(Stranger(one.servo_id, one.baud, one.model) for one in here if one.servo_id not in known)
    return Found({one.servo_id: one.baud for one in elsewhere if one.baud != former}, strangers)
