"""Reading and writing registers by name on virtual servos, and refused writes."""

from typing import Any

import pytest

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.access import GOALS, list_registers, read_register, write_register
from commissioning.scan.find import find_servo
from drivers.driver_errors import ServoError
from drivers.servos import ax_mx, scs, sts, x
from drivers.servos.catalog import registers_of, series_of
from drivers.servos.register import Access, ServoModel
from sim_backend.faults import Disturbance
from tests.commissioning.lines import ToolLine

ONE_OF_EACH = (sts.STS3215, scs.SCS0009, ax_mx.AX_12A, ax_mx.MX_28, x.XL430_W250, x.XM430_W350)
every_make = pytest.mark.parametrize("model", ONE_OF_EACH, ids=lambda model: model.name)


def line_of(model: ServoModel) -> ToolLine:
    return ToolLine(dict.fromkeys((1, 3), model))


def write(line: ToolLine, name: str, value: str | int, **options: Any) -> Any:
    with find_servo(line.port, line.clock, 3) as servo:
        return write_register(servo, name, value, **options)


def writes(line: ToolLine) -> int:
    """Number of write instructions sent to single servos or groups."""
    return sum(packet[7 if packet[3] == 0 else 4] in (3, 4, 0x83) for packet in line.sent)


@every_make
def test_list_registers_returns_the_model_table_without_writing(model: ServoModel) -> None:
    line = line_of(model)
    with find_servo(line.port, line.clock, 3) as servo:
        values = {one.name: one for one in list_registers(servo)}
    assert list(values) == [register.name for register in registers_of(model)]
    assert (values["id"].raw, values["id"].persistent, values["id"].writable) == (3, True, True)
    assert values["present_voltage"].text == f"{model.rated_voltage_v:g} V"
    assert values["model_number"].raw == model.number and model.name in values["model_number"].text
    assert writes(line) == 0


def test_a_value_has_its_unit_and_raw_number() -> None:
    line = line_of(sts.STS3215)
    line.put(3, sts.max_voltage, 121)
    with find_servo(line.port, line.clock, 3) as servo:
        value = read_register(servo, "max_voltage")
    assert (value.raw, value.value, value.unit, value.text) == (121, 12.1, "V", "12.1 V")


@every_make
def test_a_setting_is_written_once_and_is_persistent(model: ServoModel) -> None:
    line = line_of(model)
    name = "max_temperature" if series_of(model).make == "feetech" else "temperature_limit"
    written = write(line, name, "61C")
    assert (written.changed, written.after.raw) == (True, 61)
    line.servos.servo(3).power_cycle()
    register = next(r for r in registers_of(model) if r.name == name)
    assert line.held(3, register) == 61
    if lock := series_of(model).lock:
        assert line.held(3, lock) == 1
    line.sent.clear()
    assert not write(line, name, "61C").changed
    assert writes(line) == 0


@every_make
def test_goals_are_refused_and_nothing_is_written(model: ServoModel) -> None:
    line = line_of(model)
    goals = [register.name for register in registers_of(model) if register.name in GOALS]
    assert series_of(model).goal_position.name in goals
    for name in goals:
        with pytest.raises(CommissioningError, match=f"servo 3: {name} cannot be written here"):
            write(line, name, 100)
    assert writes(line) == 0


@every_make
def test_read_only_and_special_registers_are_refused(model: ServoModel) -> None:
    line = line_of(model)
    read_only = [r.name for r in registers_of(model) if r.access is Access.READ]
    for name, says in [
        *((name, "is read-only") for name in read_only),
        ("id", "set-id"),
        ("baud_rate", "set-baud"),
    ]:
        with pytest.raises(CommissioningError, match=f"servo 3: {name} .*{says}"):
            write(line, name, 0)
    assert writes(line) == 0


@every_make
def test_only_the_torque_switch_is_written_while_torque_is_on(model: ServoModel) -> None:
    line = line_of(model)
    held = series_of(model).torque_enable
    write(line, "torque_enable", 1, torque=True)
    line.sent.clear()
    for name in ("led" if series_of(model).make == "dynamixel" else "acceleration", "return_delay"):
        with pytest.raises((CommissioningError, ServoError), match=f"{name} cannot be written while the torque is"):
            write(line, name, 1)
    assert (writes(line), line.held(3, held)) == (0, 1)
    write(line, "torque_enable", 0, torque=True)
    assert line.held(3, held) == 0


@every_make
def test_the_torque_switch_needs_confirmation(model: ServoModel) -> None:
    line = line_of(model)
    with pytest.raises(CommissioningError, match="its torque is changed only if you confirm with"):
        write(line, "torque_enable", 1)
    assert (writes(line), line.held(3, series_of(model).torque_enable)) == (0, 0)


@every_make
def test_enabling_torque_holds_the_measured_position(model: ServoModel) -> None:
    line = line_of(model)
    series = series_of(model)
    stands = line.servos.servo(3)
    line.servos.servo(3).memory.put(series.goal_position, 100)
    write(line, "torque_enable", "1", torque=True)
    with find_servo(line.port, line.clock, 3) as servo:
        before = servo.read(next(r for r in registers_of(model) if r.name == "present_position"))
        line.clock.sleep_until(line.clock.now() + 1.0)
        after = servo.read(next(r for r in registers_of(model) if r.name == "present_position"))
        assert abs(servo.read(series.goal_position) - before) <= 1
    assert abs(after - before) <= 2
    assert stands.memory.get(series.torque_enable) == 1


def test_torque_is_refused_outside_the_limits_or_in_another_mode() -> None:
    line = line_of(sts.STS3215)
    line.put(3, sts.min_position, 3000)
    with pytest.raises(CommissioningError, match="outside its limits 3000 to 4095, so the servo would jump"):
        write(line, "torque_enable", 1, torque=True)
    line.put(3, sts.operating_mode, 1)
    with pytest.raises(CommissioningError, match="is not in position mode"):
        write(line, "torque_enable", 1, torque=True)
    assert line.held(3, sts.torque_enable) == 0


def test_torque_is_refused_while_a_servo_counts_turns_that_it_would_drop() -> None:
    line = line_of(x.XL430_W250)
    line.servos.servo(3).firmware._turned = -2 * 4096
    line.servos.servo(3).firmware._place_seam()
    with pytest.raises(CommissioningError, match=r"includes full turns.*'servoloop reboot 3 --port virtual'"):
        write(line, "torque_enable", 1, torque=True)
    assert line.held(3, x.torque_enable) == 0


def test_the_value_that_moves_the_zero_is_refused() -> None:
    line = line_of(sts.STS3215)
    with pytest.raises(CommissioningError, match=r"must be 0 .off. or 1 .on., not 128"):
        write(line, "torque_enable", 128, torque=True)
    assert line.held(3, sts.homing_offset) == 0


def test_ram_is_written_and_read_back() -> None:
    line = line_of(sts.STS3215)
    assert write(line, "torque_limit", "50%").after.text == "50 %"
    assert line.held(3, sts.torque_limit) == 500
    with pytest.raises(CommissioningError, match="servo 3: acceleration is still 100"):  # limited by register 85
        write(line, "acceleration", 200)


def test_a_value_that_silences_the_servo_is_refused() -> None:
    line = line_of(sts.STS3215)
    with pytest.raises(CommissioningError, match="status_level must not be 0"):
        write(line, "status_level", 0)


# Finding the servo


@pytest.mark.parametrize("baud", [1_000_000, 115_200, 38_400])
def test_find_servo_restores_the_baud_rate_of_the_port(baud: int) -> None:
    line = line_of(sts.STS3215)
    line.put(3, sts.baud_rate, sts.BAUD_RATES.index(baud))
    with find_servo(line.port, line.clock, 3) as servo:
        assert (servo.port.baud, servo.name) == (baud, "sts3215")
    assert line.port.baud == 1_000_000


def test_a_factory_new_dynamixel_is_found() -> None:
    line = ToolLine({1: x.XL330_M077})
    line.put(1, x.baud_rate, x.BAUD_RATES.index(57_600))
    with find_servo(line.port, line.clock, 1) as servo:
        assert (servo.name, servo.port.baud) == ("xl330-m077", 57_600)


def test_absent_and_duplicate_servos_are_reported() -> None:
    line = line_of(sts.STS3215)
    with (
        pytest.raises(CommissioningError, match="no servo with ID 9 responds at any baud rate"),
        find_servo(line.port, line.clock, 9),
    ):
        pass
    with (
        pytest.raises(CommissioningError, match="no servo with ID 3 responds at 500000 baud"),
        find_servo(line.port, line.clock, 3, [500_000]),
    ):
        pass
    twins = ToolLine.twins(sts.STS3215)
    with (
        pytest.raises(CommissioningError, match=r"servo 2: .*probably two servos have ID 2"),
        find_servo(twins.port, twins.clock, 2),
    ):
        pass
    assert writes(twins) == 0


@pytest.mark.parametrize("seed", range(10))
def test_a_bad_bus_causes_no_second_eeprom_write(seed: int) -> None:
    line = line_of(sts.STS3215)
    line.servos.faults.disturbance = Disturbance(seed, drop=0.06, flip=0.02, noise=0.03, miss=0.04)
    try:
        assert write(line, "max_temperature", 61).after.raw == 61
    except ServoError as error:
        assert "max_temperature" in str(error)  # the error names the register that was not written
    wear = [packet for packet in line.sent if packet[2] == 3 and packet[4] == 3 and packet[5] < 40]
    assert len(wear) <= 1
    assert line.held(3, sts.lock) == 1
