"""``servoloop calibrate`` as it is typed, interrupted; tests/ros/test_getting_started.py has it to its end."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.errors import PortError
from servoloop.arms.folder import ARMS
from sim_backend.control import ask, control_path

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
