"""Values that virtual servos save survive the end of the program: write, end, start again, and read them over the
bus."""

import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import MonotonicClock
from drivers.driver_errors import ServoSilent
from drivers.port.serial_port import SerialPort
from drivers.servos import ax_mx as dxl
from drivers.servos import scs, sts, x, xl320
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator import as_delivered, couplings, virtual_box
from sim_backend.box import VirtualBox
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.eeprom import EepromFileError, keep_eeprom
from sim_backend.line.line import ServoLine
from sim_backend.line.power import feed
from sim_backend.mechanics.plant import BenchPlant, WorldPlant
from sim_backend.scene.world import World
from tests.complaint import complaint


def line_of(models: Mapping[int, ServoModel]) -> ServoLine[Any]:
    protocol2 = any(series_of(model).protocol.name == "Dynamixel protocol 2.0" for model in models.values())
    return (VirtualDynamixelBus if protocol2 else VirtualBus).of(BenchPlant(list(models)), models)


class Run:
    """One run of the program with the file of the previous run."""

    def __init__(
        self, path: Path, models: Mapping[int, ServoModel], *, known_as: Mapping[int, ServoModel] | None = None
    ) -> None:
        self.line = line_of(models)
        keep_eeprom(path, [self.line])
        self.clock = SimulatedClock(10.0)
        self.bus = Bus(VirtualPort(self.line, self.clock), self.clock, known_as or models)

    def write(self, servo_id: int, *values: tuple[Register, int]) -> None:
        for register, value in values:
            self.bus.write(servo_id, register, value)


STS = {1: sts.STS3215, 2: sts.STS3215}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "arm.yaml"


def test_id_and_offset_written_with_the_lock_open_are_kept(path: Path) -> None:
    run = Run(path, STS)
    run.write(1, (sts.lock, 0), (sts.homing_offset, -123), (sts.servo_id, 9))
    again = Run(path, STS, known_as={9: sts.STS3215, 2: sts.STS3215})
    assert again.bus.read(9, sts.homing_offset) == -123
    assert again.bus.read(9, sts.lock) == 1
    assert again.bus.read(9, sts.present_position) == 2048 + 123
    with pytest.raises(ServoSilent):
        Run(path, STS).bus.read(1, sts.servo_id)


def test_values_written_with_the_lock_closed_are_lost(path: Path) -> None:
    run = Run(path, STS)
    run.write(2, (sts.position_p, 16))
    assert run.bus.read(2, sts.position_p) == 16
    assert Run(path, STS).bus.read(2, sts.position_p) == 32


def test_a_power_cycle_and_the_next_run_restore_the_same_values(path: Path) -> None:
    run = Run(path, STS)
    run.write(1, (sts.lock, 0), (sts.max_torque, 500), (sts.lock, 1), (sts.position_d, 7), (sts.acceleration, 20))
    feed(run.line, 0.0)
    feed(run.line, 12.0)
    run.clock.sleep_until(run.clock.now() + 1.0)
    again = Run(path, STS)
    for register in (sts.max_torque, sts.torque_limit, sts.position_d, sts.acceleration):
        assert again.bus.read(1, register) == run.bus.read(1, register)
    assert again.bus.read(1, sts.torque_limit) == 500


def test_the_saved_defaults_and_bytes_without_a_name_are_kept(path: Path) -> None:
    run = Run(path, STS)
    nameless = Register("nameless", 79, 1)
    run.write(1, (sts.lock, 0), (sts.position_p, 11), (nameless, 200))
    run.line.receive(b"\xff\xff\x01\x02\x09\xf3", 11.0)  # saves the current table as the reset values
    run.clock.sleep_until(11.1)
    run.write(1, (sts.position_p, 12))
    again = Run(path, STS)
    assert (again.bus.read(1, sts.position_p), again.bus.read(1, nameless)) == (12, 200)
    again.line.receive(b"\xff\xff\x01\x02\x06\xf6", 11.0)
    again.clock.sleep_until(11.1)
    assert again.bus.read(1, sts.position_p) == 11


@pytest.mark.parametrize(
    ("model", "unlock", "register", "value"),
    [
        (scs.SCS15, ((scs.lock, 0),), scs.max_position, 900),
        (dxl.AX_12A, (), dxl.ccw_angle_limit, 700),
        (dxl.MX_28, (), dxl.temperature_limit, 60),
        (x.XL330_M288, (), x.homing_offset, -77),
        (xl320.XL320, (), xl320.max_torque, 512),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_every_series_keeps_its_eeprom(
    path: Path, model: ServoModel, unlock: tuple[tuple[Register, int], ...], register: Register, value: int
) -> None:
    Run(path, {1: model, 2: model}).write(1, *unlock, (register, value))
    again = Run(path, {1: model, 2: model})
    assert again.bus.read(1, register) == value
    assert again.bus.read(2, register) != value


def test_the_file_lists_named_registers_by_joint(path: Path) -> None:
    Run(path, STS).write(2, (sts.lock, 0), (sts.homing_offset, 5))
    first, second = yaml.safe_load(path.read_text())["servos"]
    assert (first["joint"], first["model"], first["registers"]["homing_offset"]) == ("shaft1", "sts3215", 0)
    assert (second["joint"], second["registers"]["id"], second["registers"]["homing_offset"]) == ("shaft2", 2, 5)


def test_the_file_is_written_only_when_something_has_changed(path: Path) -> None:
    run = Run(path, STS)
    written = path.stat().st_mtime_ns
    run.write(1, (sts.torque_enable, 0), (sts.position_p, 5))
    run.bus.read(1, sts.present_position)
    assert path.stat().st_mtime_ns == written
    run.write(1, (sts.lock, 0), (sts.position_p, 5))
    assert path.stat().st_mtime_ns > written
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def changed(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("servos:", "servos: [", "is not YAML"),
        ("sts3215", "scs15", "shaft1: the model in the file is scs15, but the arm has an sts3215"),
        ("shaft2", "shaft7", "shaft7 has no servo"),
        ("shaft2", "shaft1", "shaft1 has no servo, or the file has two entries"),
        ("homing_offset: 0", "homing_offset: 5000", "homing_offset must be -2047 to 2047, not 5000"),
        ("homing_offset: 0", "homing: 0", "the servo does not store homing"),
        ("baud_rate: 0", "baud_rate: 99", "the servo does not support this baud_rate"),
        ("homing_offset: 0", "homing_offset: far", "arm.yaml:"),
        ("    4: 3", "    3: 3", "the servo does not store 3"),
        ("  registers:", "  defaults: '0011'\n  registers:", "defaults has 2 bytes instead of 87"),
    ],
)
def test_a_file_that_does_not_fit_is_refused_and_not_changed(path: Path, old: str, new: str, says: str) -> None:
    Run(path, STS)
    changed(path, old, new)
    text = path.read_text()
    with pytest.raises(EepromFileError, match=says.replace("[", r"\[")):
        Run(path, STS)
    assert path.read_text() == text


def test_a_servo_without_an_entry_has_factory_values(path: Path) -> None:
    Run(path, {1: sts.STS3215}).write(1, (sts.lock, 0), (sts.homing_offset, 5))
    run = Run(path, STS)
    assert [run.bus.read(i, sts.homing_offset) for i in STS] == [5, 0]
    assert len(yaml.safe_load(path.read_text())["servos"]) == 2


def test_an_unwritable_path_is_reported_at_once(tmp_path: Path) -> None:
    with pytest.raises(EepromFileError, match=r"cannot write .*none/arm\.yaml"):
        Run(tmp_path / "none" / "arm.yaml", STS)


def test_the_emulator_refuses_a_broken_file(
    path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path.write_text("nonsense\n")
    words = complaint(capsys, monkeypatch, "emulate", str(path.parent / "bus"), "--eeprom", str(path))
    assert str(path) in words
    assert not (path.parent / "bus").is_symlink()


@pytest.mark.slow
def test_a_killed_emulator_loses_nothing(path: Path) -> None:
    link = path.parent / "bus"
    command = [sys.executable, "-m", "servoloop", "emulate", str(link), "--eeprom", str(path)]
    for expected in (0, 42):
        emulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert emulator.stdout is not None
            assert emulator.stdout.readline().startswith("ready")
            bus = Bus(SerialPort(str(link), 1_000_000), MonotonicClock(), {3: sts.STS3215})
            assert retry(lambda bus=bus: bus.read(3, sts.homing_offset)) == expected
            retry(lambda bus=bus: bus.write(3, sts.lock, 0))
            retry(lambda bus=bus: bus.write(3, sts.homing_offset, 42))
            bus.close()
        finally:
            emulator.send_signal(signal.SIGKILL)
            emulator.communicate()
        link.unlink(missing_ok=True)


def test_ids_of_servos_from_a_box_are_kept(path: Path) -> None:
    robot = read_arm_files(find_arm("robot_arm")).robot

    def box() -> VirtualBox:
        box = virtual_box(robot, WorldPlant(World(), as_delivered(couplings(robot))))
        keep_eeprom(path, [box.line])
        return box

    first = box()
    first.connect(2)
    clock = SimulatedClock(10.0)
    bus = Bus(VirtualPort(first.line, clock), clock, {1: sts.STS3215})
    bus.write(1, sts.lock, 0)
    bus.write(1, sts.servo_id, 3)
    assert box().ids() == [1, 1, 3, 1, 1, 1, 1]
