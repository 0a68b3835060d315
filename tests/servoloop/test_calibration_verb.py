"""``servoloop calibration`` imports and exports a LeRobot file on the command line."""

import json
import os
import shlex
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from hal.joint import Joint
from servoloop.cli import app
from servoloop.stack.arm_folders import find_arm, read_arm_files
from tests.complaint import complaint
from tests.pages import commands

FILES = read_arm_files(find_arm())
JOINTS = FILES.robot.joints
PAGE = commands("calibration-files.md")


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    return Path(shutil.copy(FILES.robot_path, tmp_path / "arm.yaml"))


def theirs(joints: Sequence[Joint] = JOINTS) -> dict[str, Any]:
    """Return a LeRobot file for an arm whose stops are 20 counts above those of the URDF."""
    entries = {}
    for joint in joints:
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


def test_a_calibration_is_imported_shown_and_exported(robot: Path, tmp_path: Path) -> None:
    given, out = tmp_path / "theirs.json", tmp_path / "out.json"
    given.write_text(json.dumps(theirs(), indent=4))
    said = json.loads(run("import", str(given), "--robot", str(robot), "--json"))
    hand = JOINTS[-1]
    assert said["joints"][-1]["zero_counts"] == hand.zero_counts + 20, "its stop, 20 counts up"
    assert said["joints"][1]["zero_counts"] == 2047, "a marked pose is in no such file: LeRobot's zero"
    rows = json.loads(run("show", "--robot", str(robot), "--json"))
    assert [row["homing_offset"] for row in rows] == [-300] * len(JOINTS)
    assert rows[1]["travel"] == pytest.approx(rows[1]["urdf_range"], abs=0.004)
    run("export", str(out), "--robot", str(robot))
    assert out.read_text() == given.read_text()


@pytest.mark.runs(*PAGE)
def test_the_commands_of_the_page_work_on_a_user_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    arm = find_arm("so101")
    shutil.copytree(arm.folder, "my_arm")
    text = json.dumps(theirs(read_arm_files(arm).robot.joints), indent=4)
    Path("my_arm.json").write_text(text)
    show, take, give = (shlex.split(command.replace("--arm so101", "--arm ./my_arm"))[2:] for command in PAGE)
    run(*take)
    assert "wrist_roll" in run(*show)
    Path("my_arm.json").unlink()
    run(*give)
    assert Path("my_arm.json").read_text() == text


def test_the_output_explains_whose_zero_is_used(robot: Path, tmp_path: Path) -> None:
    given = tmp_path / "theirs.json"
    given.write_text(json.dumps(theirs()))
    assert "LeRobot's zero differs from the zero of the URDF" in run("import", str(given), "--robot", str(robot))
    assert "LeRobot's zero differs from the zero of the URDF" in run(
        "export", str(tmp_path / "out.json"), "--robot", str(robot)
    )
    assert JOINTS[0].name in run("show", "--robot", str(robot))


def test_the_calibration_plan_of_an_arm_defines_its_zeros(tmp_path: Path) -> None:
    given = tmp_path / "theirs.json"
    files = read_arm_files(find_arm("so101"))
    robot = Path(shutil.copy(files.robot_path, tmp_path / "arm.yaml"))
    given.write_text(json.dumps(theirs(files.robot.joints)))
    said = json.loads(run("import", str(given), "--arm", "so101", "--robot", str(robot), "--json"))
    zeros = {joint["joint"]: joint["zero"] for joint in said["joints"]}
    assert (zeros["shoulder_pan"], zeros["wrist_roll"], zeros["gripper"]) == ("middle", "lerobot", "lower_stop")


def test_an_invalid_calibration_file_is_reported(
    robot: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = complaint(capsys, monkeypatch, "calibration", "export", "x.json", "--robot", str(robot))
    assert "does not exist" in said and "servoloop calibrate" in said


def test_a_pipe_is_refused_as_the_file_of_an_export(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given, pipe = tmp_path / "theirs.json", tmp_path / "pipe"
    given.write_text(json.dumps(theirs()))
    run("import", str(given), "--robot", str(robot))
    os.mkfifo(pipe)
    said = complaint(capsys, monkeypatch, "calibration", "export", str(pipe), "--robot", str(robot))
    assert said == f"servoloop: cannot write {pipe}: Not a regular file\n"
    assert pipe.is_fifo()
