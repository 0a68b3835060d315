"""The demo with motions planned to poses: every cube reaches its bin, and the arm touches only the cube."""

import json
from pathlib import Path

import pytest

pytest.importorskip("moveit_msgs")
pytest.importorskip("ompl")

from tests.ros.planned_stack import servoloop

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


@pytest.mark.runs("servoloop demo --poses")
@pytest.mark.parametrize("arm", ["robot_arm", "so101"])
def test_every_cube_is_in_its_bin_without_other_contacts(arm: str, ros_domain: int, tmp_path: Path) -> None:
    ran = servoloop("demo", "--poses", "--arm", arm, "--out", str(tmp_path), limit_s=350.0)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["cubes"] == {"in_their_bins": 3, "of": 3}
    assert [run["contacts"] for run in result["runs"]] == [[], [], []]
    assert "contacts of the arm, except with the cube: none" in ran.stdout


def test_arm_without_poses_is_refused(ros_domain: int, tmp_path: Path) -> None:
    ran = servoloop("demo", "--poses", "--arm", "koch", "--out", str(tmp_path))
    assert ran.returncode == 1
    assert "koch/pick_place_poses.yaml: create this file from config/pick_place_poses.yaml" in ran.stderr
