"""The demo sorts an apple by what the virtual camera sees, from the picture to the bin."""

import io
import json
from pathlib import Path

import pytest
from PIL import Image
from rich.console import Console

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from servoloop.demo.cell_options import CellOptions
from servoloop.demo.jobs import Live
from servoloop.demo.sort_apples import sort_apples
from servoloop.demo.sorting_report import print_sorting, write_sorting

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.mark.parametrize("arm", ["robot_arm", "so101"])
def test_two_apples_are_sorted(ros_domain: int, tmp_path: Path, arm: str) -> None:
    words = io.StringIO()
    console = Console(file=words, width=200)
    report = sort_apples(CellOptions(tmp_path, arm=arm, vision=True), Live(console), 2)
    print_sorting(report, console)
    assert report.success, words.getvalue()
    assert "apples in the right bins: 2 of 2" in words.getvalue()
    assert report.median_picture_to_goal_s is not None and report.median_picture_to_goal_s < 1.0
    write_sorting(report, tmp_path / "result.json")
    sorted_apples = json.loads((tmp_path / "result.json").read_text())["sorted"]
    for apple in sorted_apples:
        assert apple["seen"]["diameter_mm"] == pytest.approx(apple["true"]["diameter_mm"], abs=3.0)
        assert apple["seen"]["grade"] == apple["true"]["grade"] == apple["bin"]
    assert Image.open(tmp_path / "apple.png").size == (640, 480)
    assert Image.open(tmp_path / "sorting.gif").n_frames > 10  # type: ignore[attr-defined]
