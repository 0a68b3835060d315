"""The demo with motions planned to poses: every cube in its bin, and no contact of the arm except with the cube."""

import io
from pathlib import Path

import pytest
from rich.console import Console

pytest.importorskip("rclpy")
pytest.importorskip("moveit_msgs")
pytest.importorskip("ompl")

from drivers.errors import DriverError
from servoloop.demo.cell import cell
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.demo import demo, succeeded
from servoloop.demo.jobs import Live

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.mark.parametrize("arm", ["robot_arm", "so101"])
def test_every_cube_is_in_its_bin_without_other_contacts(arm: str, ros_domain: int, tmp_path: Path) -> None:
    words = io.StringIO()
    with Live(Console(file=words, width=200)) as live:
        report = demo(["A", "B", "C"], 1, CellOptions(tmp_path, arm=arm, poses=True), live)
    assert succeeded(report), words.getvalue()
    assert {contact for run in report.runs for contact in run.contacts} == set()
    assert not report.comparisons


def test_arm_without_poses_is_refused(ros_domain: int, tmp_path: Path) -> None:
    live = Live(Console(file=io.StringIO()))
    with (
        pytest.raises(DriverError, match=r"--poses: .*koch/pick_place_poses.yaml is missing: write it like"),
        cell(CellOptions(tmp_path, arm="koch", poses=True), live),
    ):
        pass
