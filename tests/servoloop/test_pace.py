"""Pace of simulated time: factor, pauses and steps, with a simulated wall clock."""

import math
from collections.abc import Callable

import pytest

from drivers.driver_errors import DriverError
from servoloop.simulation.pace import LONGEST_CATCH_UP_S, POLL_S, Pace, PausedError, parse_factor

PERIOD_S = 0.05


class TestWall:
    """Wall clock that advances when a caller waits. The next function in ``events`` is called at the next wait."""

    __test__ = False

    def __init__(self) -> None:
        self.time_s = 100.0
        self.waits_s: list[float] = []
        self.events: list[Callable[[], object]] = []

    def now(self) -> float:
        return self.time_s

    def wait(self, longest_s: float) -> None:
        assert len(self.waits_s) < 10_000, "it waits for ever"
        self.waits_s.append(longest_s)
        self.time_s += longest_s
        if self.events:
            self.events.pop(0)()

    def wake(self) -> None:
        pass


class Loop:
    """Control loop whose cycles take ``busy_s`` of real time."""

    def __init__(self, factor: float, paused: bool = False, busy_s: float = 0.0) -> None:
        self.wall = TestWall()
        self.pace = Pace(factor, paused, self.wall)
        self.busy_s = busy_s
        self.cycles = 0

    def run(self, cycles: int, look: Callable[[], bool] = lambda: False) -> float:
        """Run a number of cycles and return the real time that they took, in seconds."""
        begun_s = self.wall.time_s
        for _ in range(cycles):
            self.pace.wait(self.cycles * PERIOD_S, look)
            self.wall.time_s += self.busy_s
            self.cycles += 1
        return self.wall.time_s - begun_s

    def run_while_steps_are_left(self) -> int:
        """Run until the simulation is paused again, and return the number of cycles."""
        begun, waited = self.cycles, len(self.wall.waits_s)
        while len(self.wall.waits_s) == waited:
            self.pace.wait(self.cycles * PERIOD_S, lambda: len(self.wall.waits_s) > waited)
            self.cycles += len(self.wall.waits_s) == waited
        return self.cycles - begun


@pytest.mark.parametrize("factor", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("busy_s", [0.0, 0.004])
def test_the_factor_is_kept_whatever_a_cycle_takes(factor: float, busy_s: float) -> None:
    loop = Loop(factor, busy_s=busy_s)
    loop.run(1)
    assert loop.run(200) == pytest.approx(200 * PERIOD_S / factor, abs=2 * PERIOD_S / factor)


def test_max_never_waits() -> None:
    loop = Loop(math.inf, busy_s=0.004)
    loop.run(200)
    assert loop.wall.waits_s == []


def test_a_long_stall_is_only_partly_caught_up() -> None:
    loop = Loop(1.0)
    loop.run(10)
    loop.wall.time_s += 10.0
    took_s = loop.run(100)
    assert took_s >= 100 * PERIOD_S - LONGEST_CATCH_UP_S - PERIOD_S


def test_a_short_stall_is_caught_up() -> None:
    loop = Loop(1.0)
    loop.run(10)
    loop.wall.time_s += 0.9 * LONGEST_CATCH_UP_S
    assert loop.run(100) == pytest.approx(100 * PERIOD_S - 0.9 * LONGEST_CATCH_UP_S, abs=PERIOD_S)


def test_a_pause_stops_time_and_is_not_caught_up() -> None:
    loop = Loop(5.0)
    loop.run(10)
    loop.pace.pause(True)
    loop.wall.events = [lambda: None] * 50 + [lambda: loop.pace.pause(False)]
    loop.run(1)
    assert sum(loop.wall.waits_s[-51:]) == pytest.approx(51 * POLL_S)
    assert loop.run(100) == pytest.approx(100 * PERIOD_S / 5.0, abs=PERIOD_S)
    assert "times real time" in loop.pace.summary and " 5." in loop.pace.summary


def test_a_waiting_caller_is_released_when_the_loop_ends() -> None:
    loop = Loop(0.001, paused=True)
    loop.pace.wait(0.0, lambda: len(loop.wall.waits_s) == 3)
    assert loop.wall.waits_s == [POLL_S] * 3


def test_steps_run_the_exact_number_of_cycles_and_are_done_after_the_last_one() -> None:
    loop, told = Loop(math.inf, paused=True), list[int]()
    loop.pace.on_done = lambda: told.append(loop.cycles)
    first, second = loop.pace.step(3), loop.pace.step(4)
    loop.run(3)
    assert not first.done
    loop.run(1)
    assert first.done and not second.done and told == [3]
    assert loop.run_while_steps_are_left() == 3
    assert second.done and told == [3, 7]
    assert loop.run_while_steps_are_left() == 0


def test_remaining_steps_run_when_the_pause_ends() -> None:
    loop = Loop(math.inf, paused=True)
    request = loop.pace.step(5)
    loop.run(2)
    loop.pace.pause(False)
    loop.run(4)
    assert request.done
    request.result()


def test_steps_are_refused_unless_the_simulation_is_paused() -> None:
    for pace, cycles in ((Pace(1.0), 1), (Pace(1.0, paused=True), 0)):
        with pytest.raises(PausedError):
            pace.step(cycles).result()


def test_steps_that_have_not_run_are_refused_at_the_end() -> None:
    pace = Pace(1.0, paused=True)
    left = pace.step(1)
    pace.end()
    for request in (left, pace.step(1)):
        with pytest.raises(RuntimeError, match="has ended"):
            request.result()


@pytest.mark.parametrize(("text", "factor"), [("5", 5.0), ("0.1", 0.1), ("max", math.inf), (" MAX ", math.inf)])
def test_valid_factors_are_parsed(text: str, factor: float) -> None:
    assert parse_factor(text) == factor


@pytest.mark.parametrize("text", ["0", "-1", "nan", "fast", ""])
def test_invalid_factors_are_refused(text: str) -> None:
    with pytest.raises(DriverError, match="--rtf must be max or a factor above 0"):
        parse_factor(text)
