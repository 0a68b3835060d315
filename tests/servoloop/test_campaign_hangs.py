"""Tests of runs that hang because their simulated time never ends or stands still."""

import itertools
import signal
from collections.abc import Callable
from contextlib import suppress
from threading import Event

import pytest

from hal.types import JointState
from servoloop.campaign import supervised
from servoloop.campaign.campaign import run_schedule_of
from servoloop.campaign.run import NO_HANG
from servoloop.campaign.supervised import ClockStandstill, ended_when_it_stands, longest_s
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule
from sim_backend.clock import Hang, SimulatedClock
from sim_backend.faults.text import parse

SHORT = Schedule(seconds=0.5)


class SwitchedStandstill:
    """Replaces ``ClockStandstill``: reports a standstill as soon as ``over`` is set, however slow the machine is."""

    def __init__(self) -> None:
        self.over = Event()

    def poll(self, time_s: float) -> bool:
        return self.over.is_set()


@pytest.fixture
def switched(monkeypatch: pytest.MonkeyPatch) -> SwitchedStandstill:
    """Return a clock standstill that the test triggers. The simulated time of a run is polled often."""
    switched = SwitchedStandstill()
    monkeypatch.setattr(supervised, "POLL_S", 0.01)
    monkeypatch.setattr(supervised, "ClockStandstill", lambda: switched)
    return switched


def test_the_limit_follows_from_the_schedule() -> None:
    stalled = Schedule(seconds=10.0, job=("A", "B"), faults=(parse("stall for=5s"), parse("echo for=7s")))
    assert longest_s(Schedule()) == supervised.MARGIN_S
    assert longest_s(stalled) == supervised.MARGIN_S + 2.0 * (2 * 61.0 + 10.0 + 5.0)


def test_the_clock_ends_a_run_after_its_limit() -> None:
    clock, seen = SimulatedClock(), list[float]()
    clock.last_s, clock.on_time = 2.0, seen.append
    with pytest.raises(Hang, match="longer than 2 s of simulated time"):
        for deadline_s in itertools.count(1.0):
            clock.sleep_until(deadline_s)
    assert seen == [1.0, 2.0, 3.0]


def test_a_standstill_is_detected_after_the_limit_of_equal_polls() -> None:
    standstill, extended = ClockStandstill(), ClockStandstill(30.0)
    assert [standstill.poll(0.0) for _ in range(121)] == [False] * 120 + [True]
    assert not standstill.poll(1.0) and not extended.poll(1.0)
    assert [standstill.poll(1.0) for _ in range(25)] == [False] * 23 + [True] * 2
    assert [extended.poll(1.0) for _ in range(31)] == [False] * 29 + [True] * 2
    assert not standstill.poll(1.05)


@pytest.mark.parametrize("handled", ["not", "by the stack", "and tried again"])
def test_a_run_whose_simulated_time_never_ends_is_ended_and_reported(handled: str) -> None:
    """The shutdown waits forever, even if it catches the exception that ends the run."""

    def waits(stack: FaultyStack) -> None:
        def relax() -> None:
            while True:
                try:
                    stack.clock.sleep_until(stack.clock.now() + 1.0)
                except Exception:
                    if handled == "by the stack":
                        return
                    assert handled == "and tried again"

        stack.loop.hardware.update_every_cycle = relax  # type: ignore[method-assign]

    report = run_schedule_of(SHORT, waits)
    (violation,) = report.violations
    assert violation.invariant == NO_HANG and violation.time_s == report.simulated_s
    assert supervised.MARGIN_S + 1.0 < violation.time_s < supervised.MARGIN_S + 3.0
    assert violation.text == "the program took longer than 121 s of simulated time"


def loops() -> None:
    while True:
        with suppress(Exception):
            list(range(10))


def waits() -> None:
    Event().wait()


@pytest.mark.parametrize("hang", [loops, waits])
def test_a_run_whose_time_stands_still_is_ended_and_reported(
    switched: SwitchedStandstill, hang: Callable[[], None]
) -> None:
    def stops(stack: FaultyStack) -> None:
        former, cycles = stack.on_state, itertools.count()

        def on_state(state: JointState) -> None:
            if next(cycles) == 4:
                switched.over.set()
                hang()
            former(state)

        stack.on_state = on_state

    former = signal.getsignal(supervised.SIGNAL)
    report = run_schedule_of(SHORT, stops)
    (violation,) = report.violations
    assert (violation.invariant, violation.text) == (
        NO_HANG,
        "its simulated time did not advance for 120 s of real time",
    )
    assert 0.2 < violation.time_s < 0.5
    assert signal.getsignal(supervised.SIGNAL) is former


def test_a_run_that_hangs_before_its_stack_exists_is_ended_too(
    switched: SwitchedStandstill, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(schedule: Schedule) -> float:
        switched.over.set()
        while True:
            pass

    monkeypatch.setattr(supervised, "longest_s", never)
    (violation,) = run_schedule_of(SHORT).violations
    assert (violation.invariant, violation.time_s) == (NO_HANG, 0.0)


def test_a_run_that_ends_in_time_is_not_disturbed(switched: SwitchedStandstill) -> None:
    with ended_when_it_stands(lambda: 0.0):
        pass
    switched.over.set()
