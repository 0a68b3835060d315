"""The demo of a robot with two arms: both sort at the same time, and each client reaches one arm only."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.driver_errors import DriverError
from servoloop import Arm
from servoloop.cli import app
from tests.live.rig import runtime_folder
from tests.ros.planned_stack import servoloop
from tests.servoloop.up_process import running_up

pytestmark = pytest.mark.timeout(300)


@pytest.mark.slow
@pytest.mark.runs("servoloop demo --arm bimanual_so101")
def test_both_arms_sort_three_cubes_each_at_the_same_time(ros_domain: int, tmp_path: Path) -> None:
    ran = servoloop("demo", "--arm", "bimanual_so101", "--out", str(tmp_path), limit_s=250.0)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["cubes"] == {"in_their_bins": 6, "of": 6}
    runs = {arm: content["runs"] for arm, content in result["arms"].items()}
    bins = {arm: [run["bin"] for run in own] for arm, own in runs.items()}
    assert bins == {"left": ["A", "B", "C"], "right": ["A", "B", "C"]}
    assert all(run["contacts"] == [] for own in runs.values() for run in own)
    assert result["all_arms_moved_at_once_s"] > 10.0
    assert result["loop"]["missed_cycles"] <= 0.01 * result["loop"]["cycles"]


@pytest.mark.slow
def test_one_stack_moves_both_arms_for_its_clients(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with runtime_folder(monkeypatch), running_up(tmp_path, "--hardware", "mock", "--no-ros", "--arm", "bimanual_so101"):
        with Arm.connect("bimanual_so101") as arm:
            arm.move_to({"left_shoulder_lift": -1.2, "right_shoulder_lift": -1.3}, duration=2.0)
            position = arm.state.position
            assert position["left_shoulder_lift"] == pytest.approx(-1.2, abs=0.05)
            assert position["right_shoulder_lift"] == pytest.approx(-1.3, abs=0.05)
        found = servoloop("record", str(tmp_path / "run.mcap"), "--arm", "bimanual_so101", "--seconds", "1")
        assert found.returncode == 0, found.stderr


@pytest.mark.parametrize("option", ["--vision", "--poses"])
def test_options_for_one_arm_are_refused(option: str, tmp_path: Path) -> None:
    ran = CliRunner().invoke(app, ["demo", "--arm", "bimanual_so101", option, "--out", str(tmp_path)])
    assert isinstance(ran.exception, DriverError)
    assert "bimanual_so101 has several arms, so the demo uses cubes and joint positions: omit --vision and" in str(
        ran.exception
    )


@pytest.mark.slow
def test_the_planning_server_moves_one_arm_or_both(ros_domain: int, tmp_path: Path) -> None:
    pytest.importorskip("moveit_msgs")
    pytest.importorskip("ompl")
    from tests.ros.plan_client import joint_goal, planning_stack

    with planning_stack(tmp_path, "--arm", "bimanual_so101") as client:
        for group, goal in (
            ("right_arm", {"right_shoulder_pan": 0.4, "right_shoulder_lift": -0.5}),
            ("both", {"left_shoulder_pan": -0.4, "right_shoulder_pan": 0.0}),
        ):
            result = client.run(joint_goal(group, **goal))
            assert result.error_code.val == 1, result.error_code.message
            trajectory = result.planned_trajectory.joint_trajectory
            assert {name.partition("_")[0] for name in trajectory.joint_names} == (
                {"right"} if group == "right_arm" else {"left", "right"}
            )
