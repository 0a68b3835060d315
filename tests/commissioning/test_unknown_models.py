"""Servos whose model has no control table: registers are read and written only by address, never by name."""

from collections.abc import Callable
from pathlib import Path

import pytest

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.access import list_registers, read_register, value_to_write, write_register
from commissioning.registers.address import factory_reset, reboot, set_baud, set_id
from commissioning.registers.by_address import read_address, write_address
from commissioning.scan.find import FoundServo, find_servo
from drivers.servos import sts, x
from drivers.servos.register import Register, ServoModel
from tests.commissioning.lines import ToolLine
from tests.commissioning.patient import Patient
from tests.commissioning.served import run, served

PH54_100, YM070 = 2010, 4000
"""Model numbers of ROBOTIS whose control tables differ from that of the X series."""
UNKNOWN = (
    (x.XL430_W250, x.model_number, PH54_100),
    (x.XL430_W250, x.model_number, YM070),
    (sts.STS3215, sts.model_number, 3081),
)
BY_NAME: dict[str, Callable[[FoundServo], object]] = {
    "register write position_p_gain 900": lambda servo: write_register(servo, "position_p_gain", 900),
    "register write torque_enable 1": lambda servo: write_register(servo, "torque_enable", 1, torque=True),
    "the question before a write": lambda servo: value_to_write(servo, "torque_enable", "1"),
    "register read": lambda servo: read_register(servo, "torque_enable"),
    "register list": list_registers,
    "set-id": lambda servo: set_id(servo, 5),
    "set-baud": lambda servo: set_baud(servo, 115_200),
    "factory-reset": factory_reset,
    "reboot": reboot,
}


def unknown(model: ServoModel, register: Register, number: int) -> ToolLine:
    """Return a line with one servo whose model number is unknown."""
    line = ToolLine({1: model})
    line.put(1, register, number)
    return line


@pytest.mark.parametrize("act", BY_NAME.values(), ids=BY_NAME)
@pytest.mark.parametrize(("model", "register", "number"), UNKNOWN, ids=lambda value: str(getattr(value, "name", value)))
def test_nothing_is_read_or_written_by_name(
    model: ServoModel, register: Register, number: int, act: Callable[[FoundServo], object]
) -> None:
    line = unknown(model, register, number)
    with find_servo(line.port, line.clock, 1) as servo:
        line.sent.clear()
        with pytest.raises(CommissioningError, match=rf"servo 1: .*{number}.*--address.*docs/add-a-servo\.md"):
            act(servo)
    assert line.sent == []


def test_a_scan_shows_no_value_from_another_model_s_table() -> None:
    line = unknown(*UNKNOWN[0])
    (servo,) = line.scan().servos
    assert (servo.model, servo.model_number, servo.make) == (None, PH54_100, "dynamixel")
    assert (servo.voltage_v, servo.temperature_c, servo.position_counts) == (None, None, None)
    assert (servo.torque, servo.operating_mode, servo.alarms) == (None, None, ())
    (problem,) = servo.problems
    assert problem.kind == "unknown_model" and str(PH54_100) in problem.text


def test_a_register_is_read_and_written_by_its_address() -> None:
    line = unknown(*UNKNOWN[0])
    with find_servo(line.port, line.clock, 1) as servo:
        assert read_address(servo, 84, 2).raw == 640
        written = write_address(servo, 84, 2, 900)
    assert (written.before, written.after, line.held(1, x.position_p_gain)) == (640, 900, 900)


@pytest.mark.parametrize(
    ("address", "size", "value", "says"),
    [
        (84, 3, 1, "1, 2 or 4 bytes, not 3"),
        (84, 2, 65_536, "0 to 65535, not 65536"),
        (65_535, 2, 1, "0 to 65534, not 65535"),
    ],
)
def test_an_address_size_or_value_out_of_range_is_refused(address: int, size: int, value: int, says: str) -> None:
    line = unknown(*UNKNOWN[0])
    with find_servo(line.port, line.clock, 1) as servo:
        line.sent.clear()
        with pytest.raises(CommissioningError, match=says):
            write_address(servo, address, size, value)
    assert line.sent == []


def test_a_register_that_has_a_name_is_not_written_by_its_address() -> None:
    line = ToolLine({1: x.XL430_W250})
    with find_servo(line.port, line.clock, 1) as servo:
        assert read_address(servo, 116, 4).raw == read_register(servo, "goal_position").raw
        with pytest.raises(CommissioningError, match="address 114 is part of profile_velocity: write it by name"):
            write_address(servo, 114, 2, 0)
        assert write_address(servo, 168, 2, 132).after == 132
    assert line.held(1, x.profile_velocity) == 0


def test_the_commands_take_an_address_and_ask_before_a_write(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    link = tmp_path / "bus"
    where = ("--port", str(link), "--id", "1", "--baud", "1000000")
    with served(link, {1: x.XL430_W250}) as bus:
        bus.servo(1).memory.put(x.model_number, PH54_100)
        assert run(monkeypatch, "register", "read", *where, "--address", "84", "--size", "2") == 0
        assert capsys.readouterr().out == "address 84: 640\n"
        assert run(monkeypatch, "register", "read", *where, "--address", "0x54", "--size", "2") == 0
        assert capsys.readouterr().out == "address 84: 640\n"
        assert run(monkeypatch, "register", "read", *where, "position_p_gain") == 1
        assert "--address" in capsys.readouterr().err
        write = ("register", "write", *where, "--address", "84", "--size", "2", "0x384")
        assert run(monkeypatch, *write, answer="n\n") == 1
        said = " ".join(capsys.readouterr().err.split())
        assert "cannot check what this register does, or whether the torque of the servo is enabled. Continue?" in said
        assert bus.servo(1).memory.get(x.position_p_gain) == 640
        assert run(monkeypatch, *write, "--yes") == 0
        assert capsys.readouterr().out == "servo 1: address 84 is 900, previously 640\n"
        assert bus.servo(1).memory.get(x.position_p_gain) == 900


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("read",), "pass the name of a register, or --address and --size"),
        (("read", "led", "--address", "65", "--size", "1"), "pass the name of a register, or --address and --size"),
        (("read", "--address", "65"), "--address and --size must be used together"),
        (("write", "led"), "pass a name and a value, or --address, --size and a value"),
        (("write", "led", "1", "--address", "65", "--size", "1"), "pass a name and a value, or --address"),
        (("write", "on", "--address", "65", "--size", "1"), "whole number such as 40 or 0x28, not 'on'"),
        (("read", "--address", "0x4g", "--size", "1"), "must be a number such as 40 or 0x28"),
        (("read", "--address", "-1", "--size", "1"), "must be at least 0, not -1"),
    ],
)
def test_a_name_and_an_address_exclude_each_other(
    arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, "register", *arguments, "--id", "1", "--port", "./none") != 0
    assert says in " ".join(capsys.readouterr().err.split())


def test_the_doctor_draws_no_conclusions_from_another_model_s_table() -> None:
    patient = Patient("robot_arm_dynamixel")
    patient.put(3, x.model_number, PH54_100)
    patient.put(3, x.max_voltage_limit, 100)
    report = patient.examine()
    (found,) = report.findings
    assert (found.id, found.place.servo_id) == ("wrong_model", 3)
    (servo,) = [one for one in report.buses[0].servos if one.servo_id == 3]
    assert (servo.voltage_v, servo.registers) == (None, {})
