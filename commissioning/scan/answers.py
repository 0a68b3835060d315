"""Who answers on a line, at its own rate or at another one, and which of them are two with one ID."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from calibration.eeprom import LARGEST_ID
from drivers.bus.bus import Bus
from drivers.bus.types import ServoFault
from drivers.errors import PortError, PortLost

TOGETHER: Final = 100
"""IDs in one question: an STS takes no instruction with more than 128."""
LOOKS: Final = 3
"""How often all are asked; of a line that loses 5 % of all answers one servo in eight thousand stays unseen."""
CLOSER_LOOKS: Final = 8
"""At those who answered, but not in one piece."""
SILENT: Final = ("silent", "no_time")


@dataclass(frozen=True, slots=True)
class Answer:
    """Somebody answers to this ID at this rate; ``clear``: in one piece, at least now and then."""

    servo_id: int
    baud: int
    clear: bool


def who_answers(bus: Bus, looks: int = LOOKS) -> list[Answer]:
    """All that answer at the line's rate, by ID. Only states are read. Raises PortLost."""
    found: dict[int, bool] = {}
    for _ in range(looks):
        # A bus that remembers who was silent before does not ask those each time.
        with bus.at_baud(bus.baud) as forgetful:
            for first in range(0, LARGEST_ID + 1, TOGETHER):
                _look(forgetful, range(first, min(first + TOGETHER, LARGEST_ID + 1)), found)
    if not found:
        return []
    with bus.at_baud(bus.baud) as forgetful:
        seen = {servo_id: clear or _seen_closely(forgetful, servo_id) for servo_id, clear in sorted(found.items())}
    return [Answer(servo_id, bus.baud, clear) for servo_id, clear in seen.items() if clear is not None]


def who_answers_elsewhere(bus: Bus, rates: Iterable[int]) -> list[Answer]:
    """All that answer at the first of these rates at which anybody does. The line has its own rate afterwards."""
    for baud in rates:
        try:
            with bus.at_baud(baud) as other:
                found = who_answers(other, looks=1)
        except PortLost:
            raise
        except PortError:  # the adapter does not know this rate
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
    """Whether an ID that stirred gives its state by itself; None where it was noise, or another's broken answer."""
    readings = [bus.read_states([servo_id])[servo_id] for _ in range(CLOSER_LOOKS)]
    if any(not isinstance(reading, ServoFault) for reading in readings):
        return True
    stirred = sum(isinstance(reading, ServoFault) and reading.kind not in SILENT for reading in readings)
    return False if 2 * stirred > CLOSER_LOOKS else None
