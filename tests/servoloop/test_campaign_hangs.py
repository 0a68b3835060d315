"""Runs that do not end: their simulated time goes on without end, or stands still."""

import itertools
import signal
from collections.abc import Callable
from contextlib import suppress
from threading import Event

import pytest

from hal.types import JointState
from servoloop.campaign import hangs
from servoloop.campaign.campaign import run_schedule_of
from servoloop.campaign.hangs import Standstill, ended_when_it_stands, longest_s
from servoloop.campaign.run import NO_HANG
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule
from sim_backend.clock import Hang, SimulatedClock
from sim_backend.faults.text import parse

SHORT = Schedule(seconds=0.5)


class Patience:
    """Takes a time to stand still as soon as ``over`` is set, whatever the machine is busy with."""

    def __init__(self) -> None:
        self.over = Event()

    def look(self, time_s: float) -> bool:
        return self.over.is_set()


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> Patience:
    """A fixture that looks often at the time of a run."""
    patience = Patience()
    monkeypatch.setattr(hangs, "LOOK_S", 0.01)
    monkeypatch.setattr(hangs, "Standstill", lambda: patience)
    return patience


def test_the_limit_follows_from_the_schedule() -> None:
    stalled = Schedule(seconds=10.0, job=("A", "B"), faults=(parse("stall for=5s"), parse("echo for=7s")))
    assert longest_s(Schedule()) == hangs.MARGIN_S
    assert longest_s(stalled) == hangs.MARGIN_S + 2.0 * (2 * 61.0 + 10.0 + 5.0)


def test_a_clock_ends_what_goes_on_after_its_limit() -> None:
    clock, seen = SimulatedClock(), list[float]()
    clock.last_s, clock.on_time = 2.0, seen.append
    with pytest.raises(Hang, match="longer than 2 s of simulated time"):
        for deadline_s in itertools.count(1.0):
            clock.sleep_until(deadline_s)
    assert seen == [1.0, 2.0, 3.0]


def test_a_time_stands_when_so_many_looks_have_found_it_the_same() -> None:
    standstill, patient = Standstill(), Standstill(30.0)
    assert [standstill.look(0.0) for _ in range(121)] == [False] * 120 + [True]
    assert not standstill.look(1.0) and not patient.look(1.0)
    assert [standstill.look(1.0) for _ in range(25)] == [False] * 23 + [True] * 2
    assert [patient.look(1.0) for _ in range(31)] == [False] * 29 + [True] * 2
    assert not standstill.look(1.05)


@pytest.mark.parametrize("handled", ["not", "by the stack", "and tried again"])
def test_a_run_whose_time_goes_on_without_end_is_ended_and_reported(handled: str) -> None:
    """A shutdown that waits for ever for what does not come, whatever it handles."""

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
    assert hangs.MARGIN_S + 1.0 < violation.time_s < hangs.MARGIN_S + 3.0
    assert violation.text == "it went on for longer than 121 s of simulated time"


def loops() -> None:
    while True:
        with suppress(Exception):
            list(range(10))


def waits() -> None:
    Event().wait()


@pytest.mark.parametrize("hang", [loops, waits])
def test_a_run_whose_time_stands_still_is_ended_and_reported(patience: Patience, hang: Callable[[], None]) -> None:
    def stops(stack: FaultyStack) -> None:
        former, cycles = stack.on_state, itertools.count()

        def on_state(state: JointState) -> None:
            if next(cycles) == 4:
                patience.over.set()
                hang()
            former(state)

        stack.on_state = on_state

    former = signal.getsignal(hangs.SIGNAL)
    report = run_schedule_of(SHORT, stops)
    (violation,) = report.violations
    assert (violation.invariant, violation.text) == (
        NO_HANG,
        "its simulated time stood still for 120 s of the machine's time",
    )
    assert 0.2 < violation.time_s < 0.5
    assert signal.getsignal(hangs.SIGNAL) is former


def test_a_stack_that_does_not_come_to_be_is_ended_too(patience: Patience, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(schedule: Schedule) -> float:
        patience.over.set()
        while True:
            pass

    monkeypatch.setattr(hangs, "longest_s", never)
    (violation,) = run_schedule_of(SHORT).violations
    assert (violation.invariant, violation.time_s) == (NO_HANG, 0.0)


def test_a_run_that_ends_in_time_is_not_disturbed(patience: Patience) -> None:
    with ended_when_it_stands(lambda: 0.0):
        pass
    patience.over.set()
