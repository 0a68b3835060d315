"""The report of a demo that sorts apples, and the arms that cannot sort apples."""

import io
import json
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

pytest.importorskip("rclpy")

from hal.hal_errors import ArmFileError
from nodes.clients.sorting_monitor import SeenApple, SortingJob
from servoloop.cli import app
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.jobs import Live
from servoloop.demo.sort_apples import sort_apples
from servoloop.demo.sorting import SortedApple
from servoloop.demo.sorting_report import SortingReport, print_sorting, write_sorting
from sim_backend.camera.truth import AppleTruth

TRUTH = AppleTruth((0.3, 0.0, 0.1), 55.0, 0.8, 0.01, 1.0, False, (1, 2, 3, 4))


def apple(number: int, grade: str, where: str | None, delay_s: float = 0.1, phase: str = "done") -> SortedApple:
    seen = SeenApple(10.0, grade, 55.6, 0.75, 0.02)
    return SortedApple(number, TRUTH, "A", SortingJob(number, grade, 10.0 + delay_s, seen, phase, phase), where)


def report(*apples: SortedApple) -> SortingReport:
    return SortingReport(apples, len(apples), {"missed_cycles": 0.0})


@pytest.mark.parametrize(
    ("one", "success"),
    [
        (apple(1, "A", "A"), True),
        (apple(1, "B", "B"), False),  # a wrong grade in its own bin
        (apple(1, "A", "B"), False),
        (apple(1, "A", None), False),
        (apple(1, "A", "A", phase="error"), False),
        (SortedApple(1, TRUTH, "A", None, "A"), False),
    ],
)
def test_an_apple_needs_the_right_grade_and_its_bin(one: SortedApple, success: bool) -> None:
    assert one.success is success
    assert report(one).success is success


def test_missing_apples_are_a_failure() -> None:
    assert not SortingReport((apple(1, "A", "A"),), 2, {}).success


def test_the_report_has_errors_and_delays(tmp_path: Path) -> None:
    words = io.StringIO()
    whole = report(apple(1, "A", "A", 0.1), apple(2, "A", "A", 0.3), SortedApple(3, TRUTH, "A", None, None))
    print_sorting(whole, Console(file=words, width=120))
    assert "apples in the right bins: 2 of 3; image to goal: 200 ms (median); missed cycles: 0" in words.getvalue()
    assert "+0.6" in words.getvalue() and "-0.05" in words.getvalue()
    write_sorting(whole, tmp_path / "result.json")
    content = json.loads((tmp_path / "result.json").read_text())
    assert content["apples"] == {"in_the_right_bins": 2, "of": 3} and content["sorted"][2]["seen"] is None


def test_an_arm_without_apples_is_refused_before_anything_starts(tmp_path: Path) -> None:
    options = CellOptions(tmp_path, arm="koch", vision=True)
    with pytest.raises(ArmFileError, match="use the arm robot_arm or so101"):
        sort_apples(options, Live(Console(file=io.StringIO())), 1)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("also", [["--grades", "A"], ["--repeat", "2"], ["--poses"]])
def test_options_for_cubes_are_refused_with_a_camera(also: list[str], tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["demo", "--vision", "--out", str(tmp_path), *also])
    assert "omit --grades, --repeat and --poses" in str(result.exception)
    assert list(tmp_path.iterdir()) == []
