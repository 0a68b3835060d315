"""States are confirmed only if two consecutive readings agree on the position."""

from collections.abc import Iterator, Mapping, Sequence

import pytest

from drivers.bus.confirm import AGREE_COUNTS, READINGS, confirmed_states
from drivers.types import Reading, ServoFault, ServoState, fault

SILENT = fault(1, "silent")


def state(counts: int) -> ServoState:
    return ServoState(counts, 0, 0.0, 7.4, 30.0)


def confirmed(*readings: int | None) -> tuple[Reading, int]:
    """Return the result for the readings of one servo (None: silent) and the number of readings that were taken."""
    taken = 0

    def answers() -> Iterator[Reading]:
        yield from (SILENT if counts is None else state(counts) for counts in readings)

    coming = answers()

    def read(servo_ids: Sequence[int]) -> Mapping[int, Reading]:
        nonlocal taken
        taken += 1
        return {i: next(coming) for i in servo_ids}

    return confirmed_states(read, [1])[1], taken


@pytest.mark.parametrize(
    ("readings", "counts"),
    [
        ((2000, 2000), 2000),
        ((2000, 2000 + AGREE_COUNTS), 2000 + AGREE_COUNTS),
        ((3000, 2000, 2001), 2001),
        ((2000, 3000, 2000, 2000), 2000),
        ((2000, None, 2000, 2003), 2003),
    ],
)
def test_the_newer_of_two_agreeing_readings_is_returned(readings: tuple[int | None, ...], counts: int) -> None:
    found, taken = confirmed(*readings)
    assert found == state(counts) and taken == len(readings)


def test_readings_that_never_agree_are_a_fault() -> None:
    found, taken = confirmed(*([2000, 3000] * READINGS))
    assert isinstance(found, ServoFault) and "a different position in every reading" in found.text
    assert taken == READINGS
    assert confirmed(*[None] * READINGS)[0] == SILENT
