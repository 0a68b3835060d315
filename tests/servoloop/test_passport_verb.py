"""``servoloop passport`` on the command line, with virtual servos on a pseudo-terminal."""

import json
import os
import shlex
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.eeprom import Eeprom
from drivers.servos import sts
from drivers.servos.register import Register
from servoloop.cli import app
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.processes import Interrupted
from sim_backend.buses.feetech import VirtualBus
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.sts.servo import VirtualServo
from tests.complaint import complaint
from tests.pages import commands
from tests.servoloop.served import served

IDS = tuple(range(1, 8))
PAGE = commands("passport.md")


@pytest.fixture
def line() -> VirtualBus:
    return VirtualBus.of(BenchPlant(IDS))


@pytest.fixture
def port(line: VirtualBus, tmp_path: Path) -> Iterator[str]:
    with served(line, tmp_path / "bus") as name:
        yield name


def run(*words: str, answer: str | None = None, status: int = 0) -> str:
    done = CliRunner().invoke(app, ["passport", *words], input=answer)
    assert done.exit_code == status, done.output
    return done.output


def save(line: VirtualBus, servo_id: int, value: int) -> None:
    servo = line.servo(servo_id)
    assert isinstance(servo, VirtualServo)
    servo.memory.save(sts.position_p, value)


@pytest.mark.slow
def test_a_passport_is_saved_compared_and_restored(line: VirtualBus, port: str, tmp_path: Path) -> None:
    file = str(tmp_path / "arm.passport.yaml")
    assert "servos 1, 2, 3, 4, 5, 6, 7" in run("save", file, "--port", port)
    assert "All servos match" in run("diff", file, "--port", port)
    save(line, 6, 16)
    assert "position_p" in run("diff", file, "--port", port, status=1)
    said = json.loads(run("diff", file, "--port", port, "--json", status=1))
    assert said["differences"] == [{"servo_id": 6, "register": "position_p", "saved": 32, "now": 16}]
    run("restore", file, "--port", port, answer="n\n", status=1)
    assert line.servo(6).memory.get(sts.position_p) == 16
    assert "position_p changed from 16 to 32" in run("restore", file, "--port", port, answer="y\n")
    assert line.servo(6).memory.get(sts.position_p) == 32
    assert json.loads(run("restore", file, "--port", port, "--yes", "--json")) == []


def test_servos_of_a_robot_file_have_joint_names(port: str, tmp_path: Path) -> None:
    file = str(tmp_path / "arm.passport.yaml")
    said = json.loads(run("save", file, "--port", port, "--arm", "robot_arm", "--json"))
    assert said["servos"]["7"]["joint"] == "hand_right_joint"


@pytest.mark.slow
@pytest.mark.runs(*PAGE)
def test_the_commands_of_the_page_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The port is given because this machine has no adapter. The replacement servo has the factory ID."""
    monkeypatch.chdir(tmp_path)
    save_, diff, restore, replace = (shlex.split(command)[2:] for command in PAGE)
    robot = read_arm_files(find_arm("so101")).robot
    models = {joint.servo_id: joint.model for joint in robot.joints}
    with served(VirtualBus.of(BenchPlant(tuple(models)), models), tmp_path / "old") as port:
        assert "servos 1, 2, 3, 4, 5, 6" in run(*save_, "--port", port)
        assert "All servos match" in run(*diff, "--port", port)
        run(*restore, "--port", port, answer="y\n")
    new = VirtualBus.of(BenchPlant((1,)), {1: models[6]})
    with served(new, tmp_path / "new") as port:
        run(*replace, "--port", port, answer="y\n")
    assert new.servos[0].servo_id == 6


@pytest.mark.slow
def test_a_replaced_servo_is_set_up_from_the_passport(tmp_path: Path) -> None:
    file = str(tmp_path / "arm.passport.yaml")
    old, new = VirtualBus.of(BenchPlant(IDS)), VirtualBus.of(BenchPlant((1,)))
    save(old, 6, 16)
    with served(old, tmp_path / "old") as port:
        run("save", file, "--port", port)
    with served(new, tmp_path / "new") as port:
        said = json.loads(run("restore", file, "--port", port, "--id", "6", "--to-new", "--yes", "--json"))
    assert [(one["register"], one["new"]) for one in said] == [("position_p", 16), ("id", 6)]
    assert new.servos[0].servo_id == 6


@pytest.mark.slow
def test_the_default_file_is_named_after_the_adapter(
    line: VirtualBus, port: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("servoloop.commands.passport.adapter_serial", lambda device: "5A/68 01")
    run("save", "--port", port)
    assert "adapter: 5A/68 01" in (tmp_path / "5A_68_01.passport.yaml").read_text()
    save(line, 6, 16)
    assert "position_p" in run("diff", "--port", port, status=1)
    monkeypatch.setattr("servoloop.commands.passport.adapter_serial", lambda device: "other")
    assert "with the adapter 5A/68 01, but this is the adapter other" in run(
        "restore", "5A_68_01.passport.yaml", "--port", port, "--yes"
    )
    assert line.servo(6).memory.get(sts.position_p) == 32


def test_an_adapter_without_a_serial_number_needs_a_file_name(
    port: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = complaint(capsys, monkeypatch, "passport", "save", "--port", port)
    assert "has no serial number, so its passport has no default name" in said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_the_middle_of_a_write_leaves_the_eeprom_locked(
    number: signal.Signals, line: VirtualBus, port: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = str(tmp_path / "arm.passport.yaml")
    run("save", file, "--port", port)
    save(line, 6, 16)
    put = Eeprom._put

    def signalled(memory: Eeprom, register: Register, value: int) -> None:
        assert line.servo(6).memory.get(sts.lock) == 0
        os.kill(os.getpid(), number)
        put(memory, register, value)

    monkeypatch.setattr(Eeprom, "_put", signalled)
    with pytest.raises(Interrupted, match="interrupted; the port is closed"):
        CliRunner().invoke(app, ["passport", "restore", file, "--port", port, "--yes"], catch_exceptions=False)
    assert (line.servo(6).memory.get(sts.lock), line.servo(6).memory.get(sts.position_p)) == (1, 16)


def test_errors_are_reported(
    port: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "broken.yaml"
    file.write_text("baud: 1\nservos: {1: {model: sts3215}}\n")
    said = complaint(capsys, monkeypatch, "passport", "restore", str(file), "--port", port)
    assert "broken.yaml:2: servos.1.registers" in said
    assert "--to-new requires --id" in complaint(capsys, monkeypatch, "passport", "restore", str(file), "--to-new")
    assert "add --arm or --robot" in complaint(capsys, monkeypatch, "passport", "save", str(file), "--bus", "arm")


def test_the_path_is_checked_before_the_servos_are_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "no" / "arm.passport.yaml"
    said = complaint(capsys, monkeypatch, "passport", "save", str(path), "--port", "/dev/nope")
    assert said == f"servoloop: cannot write into {path.parent}: No such file or directory\n"
