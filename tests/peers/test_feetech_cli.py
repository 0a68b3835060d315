"""Tests of the commands of feetech-cli on virtual servos, with their output."""

import re
import subprocess
import sys

import pytest

from tests.peers.conftest import Serve
from tests.peers.waiting import eventually

pytestmark = pytest.mark.slow


class Feetech:
    """feetech-cli on one line."""

    def __init__(self, link: str) -> None:
        main = "import sys; from feetech_cli.cli import main; sys.exit(main())"
        self._command = [sys.executable, "-c", main, "-p", link, "-b", "1000000", "--max-id", "9"]

    def says(self, *arguments: str, status: int = 0) -> str:
        """Run a command and return its output without colors.

        The command is tried three times, because the program does not repeat requests.
        """
        for _ in range(3):
            run = subprocess.run([*self._command, *arguments], capture_output=True, text=True, timeout=60)
            if run.returncode == status:
                break
        text = re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", run.stdout)
        assert run.returncode == status, text + run.stderr
        return text

    def value(self, servo_id: int, register: str) -> int:
        match = re.search(r"-?\d+", self.says("read", str(servo_id), register).split("=")[-1].split(":")[-1])
        assert match
        return int(match.group())


@pytest.fixture
def feetech(serve: Serve) -> Feetech:
    return Feetech(serve("sts3215", 1, 2, 5))


def test_all_servos_and_their_models_are_found(feetech: Feetech) -> None:
    found = re.compile(r"^\s*id\s+(\d+)\s+model\s+777", re.MULTILINE)
    eventually(lambda: found.findall(feetech.says("scan")) == ["1", "2", "5"])


def test_the_control_table_is_dumped(feetech: Feetech) -> None:
    table = feetech.says("info", "2", "--all")
    for register in ("model", "position", "voltage", "temperature", "homing_offset"):
        assert register in table.lower(), table


def test_a_servo_is_moved_and_its_torque_switched_off(feetech: Feetech) -> None:
    feetech.says("move", "1", "--position", "2200", "--speed", "2000", "--acceleration", "50")
    assert feetech.value(1, "torque_enable") == 1
    assert abs(feetech.value(1, "present_position") - 2200) <= 5
    feetech.says("torque", "1", "off")
    assert feetech.value(1, "torque_enable") == 0


def test_the_self_test_passes(feetech: Feetech) -> None:
    assert "PASS" in feetech.says("selftest", "2", "--moves", "2")


def test_a_servo_gets_another_id_and_another_zero(feetech: Feetech) -> None:
    feetech.says("set-id", "5", "7", "-y")
    assert feetech.value(7, "id") == 7
    feetech.says("move", "7", "--position", "2300")
    feetech.says("set-zero", "7", "-y")
    assert abs(feetech.value(7, "present_position") - 2048) <= 5
    assert feetech.value(7, "homing_offset") != 0


def test_the_mode_is_changed_and_the_factory_settings_are_restored(feetech: Feetech) -> None:
    feetech.says("mode", "2", "wheel")
    assert feetech.value(2, "operating_mode") == 1
    feetech.says("factory-reset", "2", "-y")
    assert feetech.value(2, "operating_mode") == 0
