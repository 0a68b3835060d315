"""Find all servos that respond on a bus, at the bus's own baud rate or at other rates, and detect duplicate IDs."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from drivers.bus.bus import Bus
from drivers.driver_errors import PortError, PortLost
from drivers.eeprom import LARGEST_ID
from drivers.types import ServoFault

TOGETHER: Final = 100
"""Number of IDs in one request. An STS accepts at most 128 IDs."""
LOOKS: Final = 3
"""Number of times that a request is sent to all IDs. If 5 % of the replies are lost, one servo in 8000 is not found."""
CLOSER_LOOKS: Final = 8
"""Number of additional requests to an ID whose replies were corrupted."""
SILENT: Final = ("silent", "no_time")


@dataclass(frozen=True, slots=True)
class Answer:
    """An ID that responds at a baud rate."""

    servo_id: int
    baud: int
    clear: bool
    """Whether at least some of the replies were valid."""


def who_answers(bus: Bus, looks: int = LOOKS) -> list[Answer]:
    """Return all IDs that respond at the bus's baud rate, sorted. The search only reads states. Raises PortLost."""
    found: dict[int, bool] = {}
    for _ in range(looks):
        # A bus object remembers silent servos and does not query them every time, so a new bus object is used.
        with bus.at_baud(bus.baud) as forgetful:
            for first in range(0, LARGEST_ID + 1, TOGETHER):
                _look(forgetful, range(first, min(first + TOGETHER, LARGEST_ID + 1)), found)
    if not found:
        return []
    with bus.at_baud(bus.baud) as forgetful:
        seen = {servo_id: clear or _seen_closely(forgetful, servo_id) for servo_id, clear in sorted(found.items())}
    return [Answer(servo_id, bus.baud, clear) for servo_id, clear in seen.items() if clear is not None]


def who_answers_elsewhere(bus: Bus, rates: Iterable[int]) -> list[Answer]:
    """Return all IDs that respond at the first of these rates with any reply, then restore the bus's baud rate."""
    for baud in rates:
        try:
            with bus.at_baud(baud) as other:
                found = who_answers(other, looks=1)
        except PortLost:
            raise
        except PortError:  # The adapter does not support this rate.
            continue
        if found:
            return [replace(answer, baud=baud) for answer in found]
    return []


def _look(bus: Bus, servo_ids: Iterable[int], found: dict[int, bool]) -> None:
    for servo_id, reading in bus.read_states(list(servo_ids)).items():
        if not isinstance(reading, ServoFault):
            found[servo_id] = True
        elif reading.kind not in SILENT:
            found.setdefault(servo_id, False)


def _seen_closely(bus: Bus, servo_id: int) -> bool | None:
    """Return whether an ID with corrupted replies sends a valid state when read alone; None if only noise arrives."""
    readings = [bus.read_states([servo_id])[servo_id] for _ in range(CLOSER_LOOKS)]
    if any(not isinstance(reading, ServoFault) for reading in readings):
        return True
    corrupted = sum(isinstance(reading, ServoFault) and reading.kind not in SILENT for reading in readings)
    return False if 2 * corrupted > CLOSER_LOOKS else None
