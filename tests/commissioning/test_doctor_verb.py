"""``servoloop doctor`` on a pseudo-terminal, and the settings that it recommends."""

import errno
import json
import os
import shlex
import signal
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
import yaml

from commissioning.doctor.motion import SmallMotions
from commissioning.doctor.report import markdown, without_names
from commissioning.doctor.snapshot import MotionTest
from drivers.servos import sts
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.shipped_files import CONFIG
from sim_backend.line.line import ServoLine
from tests.commissioning.patient import NOBODYS_MACHINE, Patient
from tests.commissioning.served import run, served
from tests.pages import commands

PAGE = commands("troubleshooting.md")


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "bus"


@pytest.fixture
def bus(link: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServoLine[Any]]:
    monkeypatch.setattr("commissioning.ports.adapters.Machine", lambda: NOBODYS_MACHINE)
    with served(link, dict.fromkeys(range(1, 8), sts.STS3215)) as bus:
        yield bus


def test_a_healthy_arm_has_an_anonymous_report(
    bus: ServoLine[Any], link: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    report = tmp_path / "doctor.md"
    assert run(monkeypatch, "doctor", "--port", str(link), "--report", str(report)) == 0
    assert "joint6" in capsys.readouterr().out
    text = report.read_text()
    assert "| position_p | 32 | 32 | 32 | 32 | 32 | 32 | 32 |" in text
    assert (CONFIG / "robot_arm.yaml").read_text().rstrip() in text


def test_a_report_that_cannot_be_written_hides_no_findings(
    bus: ServoLine[Any], link: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(fd: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    assert run(monkeypatch, "doctor", "--port", str(link), "--report", str(tmp_path)) == 1
    assert f"{tmp_path} is a folder: choose the name of a file" in capsys.readouterr().err
    monkeypatch.setattr("os.fsync", no_room)
    report = str(tmp_path / "doctor.md")
    assert run(monkeypatch, "doctor", "--port", str(link), "--report", report) == 1
    said = capsys.readouterr()
    assert f"cannot write {report}: No space left on device" in said.err and "joint6" in said.out


@pytest.mark.slow
@pytest.mark.runs(*PAGE)
@pytest.mark.parametrize("command", PAGE)
def test_a_command_of_the_page_reports_a_healthy_arm(
    command: str, link: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """``--move`` is declined in these tests; test_doctor_move.py moves an arm."""
    monkeypatch.setattr("commissioning.ports.adapters.Machine", lambda: NOBODYS_MACHINE)
    monkeypatch.chdir(tmp_path)
    robot = read_arm_files(find_arm("so101" if "so101" in command else "robot_arm")).robot
    with served(link, {joint.servo_id: joint.model for joint in robot.joints}):
        words = shlex.split(command.replace("/dev/ttyACM0", str(link)))
        status = run(monkeypatch, *words[1:], answer="n\n")
    said = capsys.readouterr().out
    assert status == (1 if "--move" in words else 0), said
    assert ("--json" in words) == said.startswith("{") and (tmp_path / "doctor.md").exists() == ("--report" in words)


def test_an_arm_with_warnings_and_notes_has_no_faults(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, "doctor", "--port", str(link)) == 0
    said = capsys.readouterr().out
    assert "1. warning:" in said and "note:" in said and "no faults found" in said


def test_the_commands_for_virtual_servos_name_an_emulator_that_can_be_started(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    devices = nullcontext({"": str(link)})
    monkeypatch.setattr("servoloop.stack.emulator_process.virtual_servos", lambda files: devices)
    assert run(monkeypatch, "doctor", "--port", "virtual", "--arm", "robot_arm") == 0
    said = capsys.readouterr().out
    assert "run: servoloop calibrate --arm robot_arm --port ./bus\n" in said
    assert "Before you run a command, start: servoloop emulate ./bus --arm robot_arm" in said


def test_a_fault_is_printed_as_json_with_exit_status_1(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bus.servo(4).memory.put(sts.operating_mode, 1)
    assert run(monkeypatch, "doctor", "--port", str(link), "--json") == 1
    said = json.loads(capsys.readouterr().out)
    assert said["findings"][0]["id"] == "wrong_mode"
    assert said["findings"][0]["place"] == {"bus": "", "joint": "joint4", "servo_id": 4}
    assert said["buses"][0]["servos"][3]["registers"]["operating_mode"] == 1


def test_doctor_move_asks_first_and_refuses_with_faults(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bus.servo(4).memory.put(sts.operating_mode, 1)
    assert run(monkeypatch, "doctor", "--port", str(link), "--move", answer="n\n") == 1
    assert "wrong_mode" not in capsys.readouterr().out
    assert run(monkeypatch, "doctor", "--port", str(link), "--move", "--json", answer="y\n") == 1
    said = json.loads(capsys.readouterr().out)
    assert {"wrong_mode", "not_moved"} <= {one["id"] for one in said["findings"]}


def test_an_interrupted_motion_test_has_its_own_exit_status(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(self: SmallMotions, *_: Any) -> MotionTest:
        os.kill(os.getpid(), signal.SIGTERM)
        while not self.stopped():  # another thread counts the signal
            pass
        return MotionTest(not_moved="stopped: the arm was not moved")

    monkeypatch.setattr(SmallMotions, "__call__", interrupted)
    assert run(monkeypatch, "doctor", "--port", str(link), "--move", "--yes") == 130
    said = capsys.readouterr()
    assert "stopped: the arm was not moved" in said.out and "the motion test was interrupted" in said.err


def test_a_missing_port_is_a_finding(
    link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commissioning.ports.adapters.Machine", lambda: NOBODYS_MACHINE)
    assert run(monkeypatch, "doctor", "--port", str(link)) == 1
    assert "the adapter's port does not exist" in " ".join(capsys.readouterr().out.split())


def test_the_report_contains_no_user_host_or_home_names() -> None:
    text = "run sudo usermod -aG dialout mira on bench-7: /home/mira/arm.yaml is mirabelle's"
    assert (
        without_names(text, "mira", "bench-7")
        == "run sudo usermod -aG dialout $USER on $HOST: ~/arm.yaml is mirabelle's"
    )
    patient = Patient(device="/home/mira/bus")
    assert "mira" not in markdown(patient.examine(), "mira")


def test_the_report_contains_the_highest_rate_that_the_bus_allows() -> None:
    """Request and replies of seven servos take 1.13 ms on the wire at 1 Mbit/s."""
    report = Patient().examine()
    cycle_s = report.buses[0].line.cycle_s if report.buses[0].line else None
    assert cycle_s is not None and 0.001 < cycle_s < 0.01
    assert f"update_rate must be below {1.0 / cycle_s:.0f}" in markdown(report, "")


def test_recommended_settings_are_valid_yaml() -> None:
    """Settings recommended for the robot file can be parsed."""
    patient = Patient()
    patient.put(3, sts.position_p, 16)
    cause = patient.findings()["gains_differ"].cause
    said = cause[cause.index("{") : cause.index("}") + 1]
    assert yaml.safe_load(said) == {"position_p": 16}
