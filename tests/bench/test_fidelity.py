"""Tests that the virtual servos match the figures of real servos."""

import io
import json
import sys
from pathlib import Path

import pytest
from PIL import Image
from rich.console import Console

from benchmarks import fidelity
from benchmarks.facts.figures import Figure


@pytest.fixture(scope="module")
def figures() -> list[Figure]:
    return fidelity.figures()


def test_every_figure_is_within_fifteen_percent_or_has_a_reason(figures: list[Figure]) -> None:
    assert [(figure.name, figure.measured, figure.expected) for figure in figures if not figure.fits] == []


def test_the_exceptions_have_bounds_too(figures: list[Figure]) -> None:
    for figure in figures:
        if not figure.reason:
            continue
        assert figure.expected is not None
        if figure.source == "data sheet":
            assert figure.ratio is not None
            assert 0.4 < figure.ratio < 1.0, figure
        else:
            assert abs(figure.measured - figure.expected) <= (12 if "1024" in figure.name else 2), figure


def test_the_exceptions_are_few(figures: list[Figure]) -> None:
    assert [figure.name for figure in figures if figure.reason] == [
        "step of 1024: overshoot",
        "step of 100: overshoot",
        "step of 10: final distance to the goal",
        "xl320: speed without load",
        "mx-106: torque at stall",
        "mx-64: torque at stall",
        "xl320: torque at stall",
    ]


def test_the_table_shows_every_figure_and_every_reason(figures: list[Figure]) -> None:
    text = io.StringIO()
    fidelity.show(Console(file=text, width=120), figures)
    assert all(figure.name in text.getvalue() and figure.reason in text.getvalue() for figure in figures)


def test_json_and_picture(
    figures: list[Figure], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "steps.png"
    monkeypatch.setattr(fidelity, "figures", lambda: figures[:2])
    monkeypatch.setattr(sys, "argv", ["benchmarks.fidelity", "--json", "--picture", str(picture)])
    fidelity.main()
    told = json.loads(capsys.readouterr().out)
    assert [figure["name"] for figure in told] == [figure.name for figure in figures[:2]]
    assert told[0]["ratio"] == figures[0].ratio
    with Image.open(picture) as image:
        assert len(image.getcolors(1 << 16)) > 3
