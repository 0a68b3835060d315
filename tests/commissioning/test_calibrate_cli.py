"""``servoloop calibrate`` as it is typed, on a virtual arm to practise with, moved by ``servoloop hand``'s way."""

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from math import tau
from pathlib import Path

import pytest

from drivers.errors import PortError
from servoloop.arms.folder import ARMS, find_arm, read_arm_files
from servoloop.emulator import couplings
from sim_backend.control import ask, control_path
from sim_backend.mounting import Mounting

SEED = 7
STEPS_S = 0.05
UPRIGHT = [("shoulder_lift", -1.1), ("wrist_flex", -0.5), ("elbow_flex", -0.5)]
SWEEP = [
    *[("elbow_flex", 1.75), ("elbow_flex", -1.75), ("wrist_flex", 1.75), ("wrist_flex", -1.75), ("wrist_flex", 0.0)],
    *[("shoulder_lift", 1.8), ("shoulder_lift", -1.8), ("shoulder_lift", 0.0), ("elbow_flex", -0.5)],
    *[("shoulder_pan", 2.0), ("shoulder_pan", -2.0), ("shoulder_pan", 0.0)],
    *[("wrist_roll", 2.9), ("wrist_roll", -2.8), ("wrist_roll", 0.5), ("gripper", 1.8), ("gripper", -0.2)],
]
"""Off the table all the time."""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    folder = tmp_path / "so101"
    shutil.copytree(ARMS / "so101", folder)
    return folder


@pytest.fixture
def bus(arm: Path) -> Iterator[Path]:
    """An arm to practise with, in somebody's hands."""
    link = arm.parent / "bus"
    command = [sys.executable, "-m", "servoloop", "emulate", str(link), "--arm", str(arm), "--practice", str(SEED)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and "ready" in process.stdout.readline()
        ask(control_path(link), {"do": "hold"})
        yield link
        process.terminate()


def take(link: Path, ways: list[tuple[str, float]]) -> None:
    for joint, position in ways:
        ask(control_path(link), {"do": "move", "joints": [joint], "position": position})
        while not ask(control_path(link), {"do": "look"})[joint]["arrived"]:
            time.sleep(STEPS_S)
        time.sleep(4 * STEPS_S)


def do(link: Path, text: str) -> str:
    """What the person does and answers when the program says something."""
    if text.startswith("Move every joint"):
        take(link, SWEEP)
    elif ": " in text and "Enter when it is done" in text:
        joint = text.split(":")[0]
        here = ask(control_path(link), {"do": "look"})[joint]["position"]
        if "straight above" in text:
            take(link, [(joint, 0.0487)])
        else:
            take(link, [(joint, here + 0.4)])
    elif "then the arm is limp again" in text:
        ask(control_path(link), {"do": "release"})
        return ""
    return "\n" if "Enter when it is done" in text else ""


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_an_so101_is_calibrated_from_the_command_line(arm: Path, bus: Path) -> None:
    take(bus, UPRIGHT)
    command = [sys.executable, "-m", "servoloop", "calibrate", "--arm", str(arm), "--port", str(bus), "--yes", "--json"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, bufsize=1) as process:
        assert process.stdin is not None and process.stdout is not None and process.stderr is not None
        said: list[str] = []
        for line in process.stderr:
            said.append(line)
            process.stdin.write(do(bus, line.strip()))
            process.stdin.flush()
        assert process.wait() == 0, "".join(said)
        result = json.loads(process.stdout.read())
    assert result["stored"] and result["tried_under_torque"]
    assert Path(result["file"]) == arm / "robot.calibration.yaml"
    true = {one.joint: one for one in Mounting(SEED).couplings(couplings(read_arm_files(find_arm("so101")).robot))}
    for name, made in result["joints"].items():
        off = (made["zero_counts"] + (made["homing_offset"] or 0) - true[name].zero_counts + 2048) % 4096 - 2048
        assert made["sign"] == true[name].sign and abs(off) * tau / 4096 <= 0.03, name
        assert made["doubt"] is None, name


@pytest.mark.slow
def test_a_calibration_that_is_interrupted_has_stored_nothing(arm: Path, bus: Path) -> None:
    command = [sys.executable, "-m", "servoloop", "calibrate", "--arm", str(arm), "--port", str(bus)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stderr is not None
        assert "Move every joint" in process.stderr.readline()
        process.terminate()
        rest = process.stderr.read()
    assert process.returncode == 130 and "nothing was stored" in rest
    assert not list(arm.glob("*calibration*"))


def test_a_hand_says_what_it_cannot_do_and_where_there_is_none(tmp_path: Path) -> None:
    with pytest.raises(PortError, match="no emulator takes commands at"):
        ask(control_path(tmp_path / "bus"), {"do": "look"})
