"""Interrupted runs of ``servoloop calibrate``; tests/ros/test_getting_started.py has complete runs."""

import errno
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.clock import MonotonicClock
from drivers.driver_errors import PortError
from drivers.port.serial_port import SerialPort
from drivers.servos import sts
from hal.robot_file.robot_file import load_robot_file
from servoloop.cli import app
from servoloop.stack.hardware import servo_bus
from servoloop.stack.shipped_files import ARMS
from sim_backend.control import ask, control_path
from tests.commissioning.practice import follow
from tests.complaint import complaint
from tests.pages import commands
from tests.servoloop.at_terminal import LIMIT_S, AtTerminal
from tests.servoloop.without import EXTRAS

SEED = 7


@pytest.fixture(params=["so101", "so101_leader"])
def arm(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """A copy of an arm folder, next to the folder to which it refers."""
    for name in {"so101", request.param}:
        shutil.copytree(ARMS / name, tmp_path / name)
    return Path(tmp_path / request.param)


@pytest.fixture
def bus(arm: Path) -> Iterator[Path]:
    """A virtual arm that is held by a hand."""
    link = arm.parent / "bus"
    command = [sys.executable, "-m", "servoloop", "emulate", str(link), "--arm", str(arm), "--practice", str(SEED)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and "ready" in process.stdout.readline()
        ask(control_path(link), {"do": "hold"})
        yield link
        process.terminate()


@pytest.mark.slow
@pytest.mark.runs("servoloop calibrate --arm so101_leader --port /dev/ttyACM1")
def test_an_interrupted_calibration_stores_nothing(arm: Path, bus: Path) -> None:
    """The base installation is sufficient to calibrate an arm."""
    base = [sys.executable, "-m", "tests.servoloop.without", ",".join(EXTRAS)]
    command = [*base, "calibrate", "--arm", str(arm), "--port", str(bus)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stderr is not None
        assert "Move every joint" in process.stderr.readline()
        process.terminate()
        rest = process.stderr.read()
    assert process.returncode == 130 and "nothing was stored" in rest
    assert not list(arm.glob("*calibration*"))


def servos(bus: Path, robot: Path) -> list[tuple[int, int, int]]:
    """Return torque enable and position limits of each servo."""
    clock = MonotonicClock()
    with closing(servo_bus(load_robot_file(robot), SerialPort(str(bus), 1_000_000, clock), clock)) as line:
        registers = (sts.torque_enable, sts.min_position, sts.max_position)
        return [tuple(line.read(servo_id, one) for one in registers) for servo_id in range(1, 7)]  # type: ignore[misc]


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["so101"], indirect=True)
@pytest.mark.parametrize("way_out", ["a key", "the terminal is closed"])
def test_auto_calibration_is_stopped_by_any_key_or_a_closed_terminal(way_out: str, arm: Path, bus: Path) -> None:
    ask(control_path(bus), {"do": "release"})
    command = [sys.executable, "-m", "servoloop", "calibrate", "--arm", str(arm), "--port", str(bus), "--auto"]
    with AtTerminal(command) as terminal:
        terminal.wait_for("Any key stops it. Continue? [y/N]")
        terminal.type("y\n")
        terminal.wait_for("turns a little")
        if way_out == "a key":
            terminal.type("x")
            terminal.wait_for("stopped: the ")
        else:
            terminal.close()
        assert terminal.process.wait(LIMIT_S) == 1
    assert servos(bus, arm / "robot.yaml") == [(0, 0, 4095)] * 6
    assert not list(arm.glob("*calibration*"))


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.runs(*commands("calibrate.md"))
def test_the_commands_of_the_page_calibrate_an_arm(tmp_path: Path) -> None:
    copy, emulate, calibrate, *hands = (shlex.split(command) for command in commands("calibrate.md"))
    (tmp_path / "config").symlink_to(ARMS.parent)
    subprocess.run(copy, cwd=tmp_path, check=True)

    def start(words: list[str]) -> "subprocess.Popen[str]":
        return subprocess.Popen([sys.executable, "-m", *words], cwd=tmp_path, stdout=subprocess.PIPE, text=True)

    def hand(words: list[str]) -> None:
        with start(words) as process:
            assert process.wait(60.0) == 0, words

    with start(emulate) as emulator:
        try:
            assert emulator.stdout is not None and "ready" in emulator.stdout.readline()
            *raise_, release = hands
            for words in raise_:
                hand(words)
            of_arm = [word.replace("./", f"{tmp_path}/") for word in calibrate[1:]]
            status, _, said = follow(tmp_path / "bus", *of_arm, "--yes")
            hand(release)
        finally:
            emulator.terminate()
    assert status == 0 and (tmp_path / "my_arm" / "robot.calibration.yaml").exists(), said


def test_an_unwritable_folder_is_reported_before_the_port_is_opened(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_only(dir: Path) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("commissioning.atomic_write.tempfile.TemporaryFile", read_only)
    said = complaint(capsys, monkeypatch, "calibrate", "--arm", "so101", "--port", str(tmp_path / "none"))
    assert f"cannot write into {ARMS / 'so101'}: Read-only file system; copy the arm's folder" in said


@pytest.mark.parametrize("arm", ["so101"], indirect=True)
@pytest.mark.parametrize(
    ("part", "right", "wrong"),
    [("stops", "wrist_flex: 0.0", "wrist_flx: 0.0"), ("drive", "shoulder_lift: 0.8", "shoulder_lft: 0.8")],
)
def test_an_unknown_joint_in_the_plan_ends_an_automatic_calibration_before_it_begins(
    part: str, right: str, wrong: str, arm: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise, the arm could press on its table, or would have too little torque to lift a load."""
    file = arm / "arm.yaml"
    before, after = file.read_text().split(right)
    file.write_text(before + wrong + after)
    line, name = before.count("\n") + 1, wrong.partition(":")[0]
    monkeypatch.setenv("COLUMNS", "1000")
    port = str(arm / "none")
    said = complaint(capsys, monkeypatch, "calibrate", "--arm", f"{arm}/", "--port", port, "--auto", "--yes")
    assert f"{file}:{line}: calibration.auto.{part} lists {name}. No servo has this name: use one of shoulder" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("hold", "elbow_flex", "0.3"), "hold takes no position: omit 0.3, or use move"),
        (("lay", "elbow_flex"), "lay takes no joint: omit elbow_flex"),
    ],
)
def test_the_hand_command_refuses_arguments_without_effect(
    words: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    result = CliRunner().invoke(app, ["hand", str(tmp_path / "bus"), *words])
    assert message in str(result.exception)


def test_the_hand_command_reports_impossible_actions_and_missing_hands(tmp_path: Path) -> None:
    with pytest.raises(
        PortError, match=r"no emulator serves \S+/bus \(No such file or directory\): start 'servoloop emu"
    ):
        ask(control_path(tmp_path / "bus"), {"do": "look"})
    result = CliRunner().invoke(app, ["hand", str(tmp_path / "bus"), "move", "elbow_flex", "-0.5"])
    assert "no emulator serves" in str(result.exception), "a negative number is not an option"
