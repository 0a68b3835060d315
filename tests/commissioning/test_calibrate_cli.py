"""``servoloop calibrate`` as it is typed, on a virtual arm to practise with, moved by ``servoloop hand``'s way."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from math import tau
from pathlib import Path

import pytest

from drivers.errors import PortError
from servoloop.arms.folder import ARMS, find_arm, read_arm_files
from servoloop.emulator import couplings
from sim_backend.control import ask, control_path
from sim_backend.mounting import Mounting
from tests.commissioning.practice import UPRIGHT, follow, take

SEED = 7


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


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_an_so101_is_calibrated_from_the_command_line(arm: Path, bus: Path) -> None:
    take(bus, UPRIGHT)
    status, printed, said = follow(bus, "calibrate", "--arm", str(arm), "--port", str(bus), "--yes", "--json")
    assert status == 0, said
    result = json.loads(printed)
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
