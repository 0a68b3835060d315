"""Both arms of a combined robot are calibrated as docs/two-arms.md describes, one after the other."""

import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hal.robot_file.calibration_file import load_calibration
from servoloop import Arm
from servoloop.commands.output.calibrate_terminal import common_prefix
from sim_backend.control import ask, control_path
from tests.commissioning.practice import UPRIGHT, follow, take, tell
from tests.live.rig import runtime_folder
from tests.pages import commands
from tests.servoloop.served import eventually

COMBINE, *_ = (line for line in commands("two-arms.md") if line.startswith("servoloop arms combine"))
CALIBRATE = [line for line in commands("two-arms.md") if line.startswith("servoloop calibrate")]


@pytest.fixture
def bus(tmp_path: Path) -> Iterator[Path]:
    """Two virtual arms with random zeros and directions, raised off the table."""
    subprocess.run([sys.executable, "-m", *shlex.split(COMBINE)], cwd=tmp_path, check=True, capture_output=True)
    command = [sys.executable, "-m", "servoloop", "emulate", "./bus", "--arm", "./two_arms", "--practice", "3"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and "ready" in process.stdout.readline()
        link = tmp_path / "bus"
        tell(link, "hold")
        take(link, [(f"{arm}_{joint}", position) for arm in ("left", "right") for joint, position in UPRIGHT])
        yield link
        process.terminate()


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_both_arms_are_calibrated_one_after_the_other(
    bus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, stored = tmp_path / "two_arms", set[str]()
    for command, name in zip(CALIBRATE, ("left", "right"), strict=True):
        words = [
            word.replace("./two_arms", str(folder)).replace("/dev/ttyACM0", f"{bus}.left")
            for word in shlex.split(command)
        ]
        words = [word.replace("/dev/ttyACM1", f"{bus}.right") for word in words]
        status, _, said = follow(bus, *words[1:], "--yes", prefix=f"{name}_")
        assert status == 0, said
        assert f"Only the joints on the bus {name} are calibrated" in said and f"{name}_…" in said
        calibration = load_calibration(folder / "robot.yaml")
        assert calibration is not None
        joints = {joint for joint in calibration.joints if joint.startswith(f"{name}_")}
        assert len(joints) == 6 and calibration.joints.keys() == stored | joints
        stored |= joints
    tell(bus, "release")
    ready = tmp_path / "ready"
    up = ["up", "--no-ros", "--arm", str(folder), "--port", f"left={bus}.left", "--port", f"right={bus}.right"]
    with runtime_folder(monkeypatch):
        process = subprocess.Popen([sys.executable, "-m", "servoloop", *up, "--ready-file", str(ready)])
        try:
            eventually(lambda: ready.exists() or process.poll() is not None, 60.0)
            with Arm.connect("two_arms") as arm:
                measured = arm.state.position
            for joint, true in ask(control_path(bus), {"do": "look"}).items():
                assert measured[joint] == pytest.approx(true["position"], abs=0.05), joint
        finally:
            process.terminate()
            assert process.wait(60.0) == 0


@pytest.mark.parametrize(
    ("joints", "prefix"),
    [
        (["left_shoulder_pan", "left_shoulder_lift"], "left_shoulder_"),
        (["left_shoulder_pan", "left_gripper"], "left_"),
        (["big_left_pan", "big_left_lift"], "big_left_"),
        (["shoulder_pan", "gripper"], ""),
        (["joint1", "joint2"], ""),
    ],
)
def test_table_shows_the_prefix_of_an_arm_once(joints: list[str], prefix: str) -> None:
    assert common_prefix(joints) == prefix
