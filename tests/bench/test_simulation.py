"""Tests that the benchmark of the simulation is complete, regardless of the figures."""

import io
import json
import sys
import time

import pytest
from rich.console import Console

from benchmarks import invariants, simulation
from benchmarks.shared import stopwatch
from servoloop.campaign.campaign import files_of
from servoloop.campaign.invariants import Invariant
from servoloop.campaign.invariants.watch import ALL
from servoloop.campaign.run import run_schedule
from servoloop.campaign.scenario import Scenario
from servoloop.simulation.job import job_settings
from servoloop.simulation.schedule import Schedule
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.shipped_files import OWN

PARTS = {"world", "servos", "line and packets", "driver", "controllers", "compensation", "loop"}


def test_every_part_is_measured_and_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    short = Scenario(seconds=0.5, within_s=0.5)
    figures = simulation.measure(runs=1, steps=50, scenario=short, seeds=1)
    assert min(figures.world, figures.servos, figures.stack) > 0.0
    assert set(figures.shares) == PARTS and min(figures.shares.values()) > 0.0
    assert sum(figures.shares.values()) == pytest.approx(1.0)
    text = io.StringIO()
    simulation.show(Console(file=text, width=120), figures)
    assert all(part in text.getvalue() for part in PARTS)
    cost = figures.invariants
    assert cost.runs == 1 and cost.without_s > 0.0 and cost.ratio == cost.with_all_s / cost.without_s
    assert set(cost.shares) == {kind.name for kind in ALL} and sum(cost.shares.values()) == pytest.approx(1.0)
    assert all(name in text.getvalue() for name in cost.shares)
    assert f"{cost.ratio:.2f}" in text.getvalue()
    monkeypatch.setattr(simulation, "measure", lambda: figures)
    monkeypatch.setattr(sys, "argv", ["benchmarks.simulation", "--json"])
    simulation.main()
    printed = json.loads(capsys.readouterr().out)
    assert printed["shares"] == figures.shares and printed["invariants"]["ratio"] == cost.ratio


def test_a_timed_invariant_has_the_same_results() -> None:
    class Moves(Invariant):
        """Nothing moves."""

        name = "moves"

        def on_step(self, time_s: float) -> None:
            self.examined += 1
            self.say("it moves")

    watch = stopwatch.Stopwatch()
    timed = invariants.timed(Moves, watch)
    settings = job_settings(find_arm(OWN), ())
    plain, measured = (run_schedule(files_of(OWN), settings, Schedule(seconds=0.2), (kind,)) for kind in (Moves, timed))
    assert measured.violations == plain.violations and measured.examined == plain.examined
    assert measured.examined["moves"] > 200 and watch.spent_s["moves"] > 0.0


def test_the_time_of_called_parts_is_not_counted_twice() -> None:
    class Part:
        def inner(self) -> None:
            clock[0] += 2.0

        def outer(self) -> None:
            clock[0] += 1.0
            self.inner()
            clock[0] += 3.0

    clock, part, watch = [0.0], Part(), stopwatch.Stopwatch()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "perf_counter", lambda: clock[0])
        watch.watch("inside", part, "inner")
        watch.watch("around", part, "outer")
        part.outer()
    assert watch.spent_s == {"inside": 2.0, "around": 4.0}
    assert watch.shares() == {"inside": 2.0 / 6.0, "around": 4.0 / 6.0}
