"""``servoloop calibration`` as a user types it: a file of LeRobot's for the demo's arm goes in and comes out."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from servoloop.cli import app
from servoloop.files import CONFIG, ROBOT, read_files
from tests.complaint import complaint

JOINTS = read_files().robot.joints


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    return Path(shutil.copy(CONFIG / ROBOT, tmp_path / "arm.yaml"))


def theirs() -> dict[str, Any]:
    """LeRobot's file for an arm whose stops are where the URDF has them, but 20 counts up."""
    entries = {}
    for joint in JOINTS:
        low, high = joint.counts_range()
        entries[joint.name] = {
            **{"id": joint.servo_id, "drive_mode": 0, "homing_offset": -300},
            **{"range_min": low + 20, "range_max": min(high + 20, 4095)},
        }
    return entries


def run(*words: str) -> str:
    done = CliRunner().invoke(app, ["calibration", *words])
    assert done.exit_code == 0, done.output
    return done.output


def test_in_shown_and_out_again(robot: Path, tmp_path: Path) -> None:
    given, out = tmp_path / "theirs.json", tmp_path / "out.json"
    given.write_text(json.dumps(theirs(), indent=4))
    said = json.loads(run("import", str(given), "--robot", str(robot), "--json"))
    assert [joint["zero_counts"] for joint in said["joints"]][1] == JOINTS[1].zero_counts + 20
    rows = json.loads(run("show", "--robot", str(robot), "--json"))
    assert [row["homing_offset"] for row in rows] == [-300] * len(JOINTS)
    assert rows[1]["travel"] == pytest.approx(rows[1]["urdf_range"], abs=0.004)
    run("export", str(out), "--robot", str(robot))
    assert out.read_text() == given.read_text()


def test_people_are_told_whose_zero_it_is(robot: Path, tmp_path: Path) -> None:
    given = tmp_path / "theirs.json"
    given.write_text(json.dumps(theirs()))
    assert "LeRobot's zero is not the URDF's" in run("import", str(given), "--robot", str(robot))
    assert "LeRobot's zero is not the URDF's" in run("export", str(tmp_path / "out.json"), "--robot", str(robot))
    assert JOINTS[0].name in run("show", "--robot", str(robot))


def test_a_plan_names_other_places_for_zeros(robot: Path, tmp_path: Path) -> None:
    given, plan = tmp_path / "theirs.json", tmp_path / "plan.yaml"
    given.write_text(json.dumps(theirs()))
    plan.write_text("joints: {joint1: {positive: to the left, zero: lower_stop}}")
    said = json.loads(run("import", str(given), "--robot", str(robot), "--plan", str(plan), "--json"))
    assert [joint["zero"] for joint in said["joints"]][:2] == ["lower_stop", "middle"]


def test_a_mistake_is_said_in_words(
    robot: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = complaint(capsys, monkeypatch, "calibration", "export", "x.json", "--robot", str(robot))
    assert "there is no" in said and "servoloop calibrate" in said
