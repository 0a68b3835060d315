"""Schedules of runs that hang, are killed or do not fail again are kept as they were drawn, with a note."""

from pathlib import Path

import pytest

from servoloop.campaign import kept_violation, report, shrink
from servoloop.campaign.invariants import Violation
from servoloop.campaign.kept_violation import AS_DRAWN, UNSEEN, keep
from servoloop.campaign.run import NO_CRASH, NO_HANG, NOT_KILLED, RunReport, lost_run
from servoloop.campaign.scenario import Scenario
from servoloop.campaign.shrink import smallest, violated_apart
from servoloop.campaign.supervised import Loss
from servoloop.campaign.tally import Tally
from servoloop.simulation.schedule import Schedule, read_schedule
from sim_backend.faults.text import parse
from tests.servoloop.test_campaign_report import Page

DRAWN = Schedule(seed=7, seconds=1.5, faults=(parse("echo at=0.5s"), parse("silent id=3 at=1s")))


def never() -> bool:
    return False


@pytest.mark.parametrize("name", [NO_HANG, NOT_KILLED])
def test_a_run_that_hangs_or_is_killed_is_kept_but_not_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(kept_violation, "run_schedule_of", None)
    monkeypatch.setattr(shrink, "run_schedule_of", None)
    kept = keep(lost_run(DRAWN, name, 1.23456, "it did not\nend"), name, tmp_path, never)
    assert kept.violation == Violation(name, 1.2346, "it did not\nend")
    assert read_schedule(kept.schedule_path) == DRAWN and kept.trace_path is None
    first, second = kept.schedule_path.read_text().splitlines()[:2]
    assert (first, second) == (f"# {name}: it did not end", f"# {AS_DRAWN[name]}")
    text = report.page(None, [kept])
    Page(text)
    assert AS_DRAWN[name] in text and "before the first cycle" not in text


def test_a_violation_that_does_not_recur_is_kept_as_it_was_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def passes(schedule: Schedule, *_: object) -> RunReport:
        return RunReport(schedule, (), 0, "", 1.0, None)

    monkeypatch.setattr(kept_violation, "run_schedule_of", passes)
    monkeypatch.setattr(shrink, "run_schedule_of", passes)
    kept = keep(lost_run(DRAWN, NO_CRASH, 1.0, "MemoryError: "), NO_CRASH, tmp_path, never)
    assert kept.note == UNSEEN and read_schedule(kept.schedule_path) == DRAWN


def test_minimizing_ends_at_a_schedule_that_hangs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[Schedule] = []

    def hangs_without_echo(schedule: Schedule, *_: object) -> RunReport:
        ran.append(schedule)
        hangs = not any(event.kind == "echo" for event in schedule.faults)
        return lost_run(schedule, NO_HANG if hangs else NO_CRASH, 1.0, "")

    monkeypatch.setattr(kept_violation, "run_schedule_of", hangs_without_echo)
    monkeypatch.setattr(shrink, "run_schedule_of", hangs_without_echo)
    kept = keep(lost_run(DRAWN, NO_CRASH, 1.0, ""), NO_CRASH, tmp_path, never)
    assert (kept.violation.invariant, kept.schedule, kept.note) == (NO_CRASH, DRAWN, "")
    assert len(ran) == 2


class LosingSupervisor:
    """Supervisor whose process is always lost."""

    def __init__(self, loss: Loss) -> None:
        self._loss, self.closed = loss, False

    def run(self, run: object, schedule: Schedule) -> Loss:
        return self._loss

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize(("hung", "name"), [(True, NO_HANG), (False, NOT_KILLED)])
def test_a_schedule_that_ends_its_process_ends_only_the_minimizing(
    monkeypatch: pytest.MonkeyPatch, hung: bool, name: str
) -> None:
    lost = LosingSupervisor(Loss(hung, 0.5, "lost"))
    monkeypatch.setattr(shrink, "Supervisor", lambda: lost)
    with violated_apart() as violated:
        assert violated(DRAWN) == {name}
        assert smallest(DRAWN, NO_CRASH, violated, never) == DRAWN
    assert lost.closed


def test_the_report_of_a_campaign_shows_lost_runs() -> None:
    tally = Tally(Scenario(seconds=1.5), 2)
    tally.add(lost_run(DRAWN, NO_HANG, 1.0, "it went on"))
    tally.add(lost_run(DRAWN.model_copy(update={"seed": 8}), NOT_KILLED, 0.5, "SIGKILL"))
    assert [(one["seed"], one["invariant"]) for one in tally.plain()["violations"]] == [(7, NO_HANG), (8, NOT_KILLED)]
    assert tally.ended == 0, "a lost run was not ended by a lost bus"
    assert {NO_HANG, NOT_KILLED}.isdisjoint(name for name, *_ in tally.marks)
    text = report.page(tally, [])
    assert NO_HANG in text and NOT_KILLED in text
