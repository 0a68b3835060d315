"""Two clocks cannot be read at the same instant, so the fastest of several readings is used."""

from collections.abc import Callable, Sequence

import pytest

from drivers.clock import wall_offset_s
from sim_backend.clock import SimulatedClock

OFFSET_S = 1.7e9


def wall_of(clock: SimulatedClock, held_up_s: Sequence[tuple[float, float]]) -> Callable[[], float]:
    """A wall clock. The thread is delayed by these times before and after it reads the clock."""
    pairs = list(held_up_s)

    def read() -> float:
        before_s, after_s = pairs.pop(0) if pairs else (0.0, 0.0)
        clock.sleep_until(clock.now() + before_s)
        wall_s = clock.now() + OFFSET_S
        clock.sleep_until(clock.now() + after_s)
        return wall_s

    return read


@pytest.mark.parametrize("held_up_s", [[], [(0.1, 0.0)], [(0.0, 0.1)], [(0.1, 0.0)] * 4, [(0.1, 0.0), (0.0, 0.02)]])
def test_a_reading_that_was_delayed_is_repeated(held_up_s: list[tuple[float, float]]) -> None:
    clock = SimulatedClock(100.0)
    assert wall_offset_s(clock, wall_of(clock, held_up_s)) == pytest.approx(OFFSET_S, abs=1e-5)


def test_the_fastest_reading_counts_if_all_are_delayed() -> None:
    clock = SimulatedClock(100.0)
    wall = wall_of(clock, [(0.1, 0.0), (0.004, 0.0), (0.2, 0.0)] + [(0.1, 0.0)] * 100)
    assert wall_offset_s(clock, wall) == pytest.approx(OFFSET_S, abs=0.0021)
