"""How fast the simulation is: the bench is complete, whatever the figures."""

import io
import json
import sys

import pytest
from rich.console import Console

from benchmarks import simulation

PARTS = {"world", "servos", "line and packets", "driver", "controllers", "compensation", "loop"}


def test_it_measures_every_part_and_prints_all(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = simulation.measure(runs=1, steps=50)
    assert min(figures.world, figures.servos, figures.stack) > 0.0
    assert set(figures.shares) == PARTS and min(figures.shares.values()) > 0.0
    assert sum(figures.shares.values()) == pytest.approx(1.0)
    text = io.StringIO()
    simulation.show(Console(file=text, width=120), figures)
    assert all(part in text.getvalue() for part in PARTS)
    monkeypatch.setattr(simulation, "measure", lambda: figures)
    monkeypatch.setattr(sys, "argv", ["benchmarks.simulation", "--json"])
    simulation.main()
    assert json.loads(capsys.readouterr().out)["shares"] == figures.shares


def test_a_part_is_not_charged_for_what_it_calls() -> None:
    class Part:
        def inner(self) -> None:
            clock[0] += 2.0

        def outer(self) -> None:
            clock[0] += 1.0
            self.inner()
            clock[0] += 3.0

    clock, part, stopwatch = [0.0], Part(), simulation.Stopwatch()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation.time, "perf_counter", lambda: clock[0])
        stopwatch.watch("inside", part, "inner")
        stopwatch.watch("around", part, "outer")
        part.outer()
    assert stopwatch.spent_s == {"inside": 2.0, "around": 4.0}
    assert stopwatch.shares() == {"inside": 2.0 / 6.0, "around": 4.0 / 6.0}
