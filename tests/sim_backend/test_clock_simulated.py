"""The simulated clock advances only when a program sleeps."""

from drivers.clock import Clock
from sim_backend.clock import SimulatedClock


def test_sleeping_advances_the_time_to_the_deadline() -> None:
    clock: Clock = SimulatedClock(3.0)
    clock.sleep_until(4.5)
    assert clock.now() == 4.5


def test_a_past_deadline_does_not_change_the_time() -> None:
    clock = SimulatedClock(3.0)
    clock.sleep_until(1.0)
    assert clock.now() == 3.0


def test_reading_the_time_does_not_advance_it() -> None:
    clock = SimulatedClock()
    assert [clock.now() for _ in range(3)] == [0.0, 0.0, 0.0]
