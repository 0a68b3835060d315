"""ID, baud rate, factory reset and reboot on virtual servos never lose a servo or duplicate an ID."""

from typing import Any

import pytest

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.access import write_register
from commissioning.registers.address import factory_reset, reboot, set_baud, set_id
from commissioning.registers.tables import rates_of
from commissioning.scan.find import find_servo
from drivers.driver_errors import PortError, ServoRefused
from drivers.eeprom import EepromError
from drivers.servos import ax_mx, scs, sts, x
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from sim_backend.faults import Disturbance
from tests.commissioning.lines import ToolLine

ONE_OF_EACH = (sts.STS3215, scs.SCS0009, ax_mx.AX_12A, ax_mx.MX_28, x.XL430_W250)
every_make = pytest.mark.parametrize("model", ONE_OF_EACH, ids=lambda model: model.name)


def line_of(model: ServoModel) -> ToolLine:
    return ToolLine(dict.fromkeys((1, 3), model))


def told(line: ToolLine, function: Any, servo_id: int, *arguments: Any, **options: Any) -> Any:
    with find_servo(line.port, line.clock, servo_id) as servo:
        return function(servo, *arguments, **options)


def switched_on(line: ToolLine, servo_id: int) -> None:
    told(line, write_register, servo_id, "torque_enable", 1, torque=True)


# The ID


@every_make
def test_set_id_is_persistent_and_locks_the_eeprom(model: ServoModel) -> None:
    line = line_of(model)
    changed = told(line, set_id, 3, 7)
    assert (changed.old_id, changed.new_id, changed.baud) == (3, 7, 1_000_000)
    servo = line.servos.servo(7)
    servo.power_cycle()
    assert sorted(one.servo_id for one in line.servos.servos) == [1, 7]
    if lock := series_of(model).lock:
        assert servo.memory.get(lock) == 1


@every_make
def test_an_id_that_is_taken_is_refused(model: ServoModel) -> None:
    line = line_of(model)
    with pytest.raises(EepromError, match=r"servo 3: .*another servo has this ID"):
        told(line, set_id, 3, 1)
    assert sorted(one.servo_id for one in line.servos.servos) == [1, 3]


def test_an_id_that_is_taken_is_refused_on_a_bad_bus() -> None:
    for seed in range(20):
        line = line_of(sts.STS3215)
        line.servos.faults.disturbance = Disturbance(seed, drop=0.05, miss=0.05)
        with pytest.raises((EepromError, CommissioningError)):
            told(line, set_id, 3, 1)
        assert sorted(one.servo_id for one in line.servos.servos) == [1, 3]


def test_set_id_refuses_two_servos_with_the_same_id() -> None:
    line = ToolLine.twins(sts.STS3215)
    with pytest.raises(CommissioningError, match="probably two servos have ID 2"):
        told(line, set_id, 2, 5)
    assert sorted(one.servo_id for one in line.servos.servos) == [1, 2, 2]


def test_set_id_reports_a_second_servo_that_kept_the_old_id(monkeypatch: pytest.MonkeyPatch) -> None:
    line = ToolLine.twins(sts.STS3215, apart=False)
    memory = line.servos.servos[2].memory
    write = memory.write
    monkeypatch.setattr(memory, "write", lambda at, data: None if at == sts.servo_id.address else write(at, data))
    with pytest.raises(CommissioningError, match="one servo now has ID 5, but another servo still responds to ID 2"):
        told(line, set_id, 2, 5)


@pytest.mark.parametrize(("model", "new_id"), [(sts.STS3215, 254), (x.XL430_W250, 253), (sts.STS3215, -1)])
def test_set_id_refuses_ids_out_of_range(model: ServoModel, new_id: int) -> None:
    line = line_of(model)
    with pytest.raises(CommissioningError, match=f"the new ID must be 0 to .*, not {new_id}"):
        told(line, set_id, 3, new_id)


@every_make
def test_id_and_baud_rate_are_not_changed_while_torque_is_on(model: ServoModel) -> None:
    line = line_of(model)
    switched_on(line, 3)
    with pytest.raises(EepromError, match=r"the torque of the servo is enabled\. Support the arm"):
        told(line, set_id, 3, 7)
    with pytest.raises(EepromError, match=r"the torque of the servo is enabled\. Support the arm"):
        told(line, set_baud, 3, 57_600)
    assert sorted((one.servo_id, one.baud) for one in line.servos.servos) == [(1, 1_000_000), (3, 1_000_000)]


# The rate


@every_make
def test_set_baud_is_verified_persistent_and_reversible(model: ServoModel) -> None:
    line = line_of(model)
    # Virtual protocol 1.0 servos use the exact baud rate, not the nominal one.
    rate = 200_000 if series_of(model).name == "Dynamixel protocol 1.0" else 115_200
    assert told(line, set_baud, 3, rate).old_baud == 1_000_000
    servo = line.servos.servo(3)
    servo.power_cycle()
    assert servo.baud == rate
    if lock := series_of(model).lock:
        assert servo.memory.get(lock) == 1
    assert line.port.baud == 1_000_000
    back = told(line, set_baud, 3, 1_000_000)
    assert (back.old_baud, back.new_baud, servo.baud) == (rate, 1_000_000, 1_000_000)


def test_set_baud_lists_the_supported_rates() -> None:
    line = line_of(sts.STS3215)
    with pytest.raises(
        CommissioningError, match=r"sts3215 does not support 2000000 baud. Use one of 38400, .* 1000000"
    ):
        told(line, set_baud, 3, 2_000_000)
    assert set(rates_of(sts.STS3215).values()) == set(sts.BAUD_RATES)


def test_set_baud_refuses_a_rate_at_which_the_id_is_taken() -> None:
    line = ToolLine({1: sts.STS3215, 3: sts.STS3215, 4: sts.STS3215})
    line.put(4, sts.baud_rate, 4)
    line.put(4, sts.servo_id, 3)
    with pytest.raises(CommissioningError, match="another servo with this ID already responds at 115200 baud"):
        told(line, set_baud, 3, 115_200)
    assert sorted(one.baud for one in line.servos.servos) == [115_200, 1_000_000, 1_000_000]


def test_set_baud_refuses_a_rate_that_the_adapter_does_not_support() -> None:
    line = line_of(sts.STS3215)
    set_rate = line.port.set_baud

    def limited(baud: int) -> None:
        if baud == 128_000:
            raise PortError(f"no {baud}")
        set_rate(baud)

    line.port.set_baud = limited  # type: ignore[method-assign]
    with pytest.raises(PortError, match="no 128000"):
        told(line, set_baud, 3, 128_000)
    assert line.servos.servo(3).baud == 1_000_000
    assert line.port.baud == 1_000_000


def test_set_baud_reports_a_servo_that_keeps_its_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    line = line_of(sts.STS3215)
    memory = line.servos.servo(3).memory
    write = memory.write
    monkeypatch.setattr(memory, "write", lambda at, data: None if at == sts.baud_rate.address else write(at, data))
    with pytest.raises(EepromError, match="is still at 1000000 baud: the servo does not accept 500000"):
        told(line, set_baud, 3, 500_000)
    assert line.held(3, sts.lock) == 1


@pytest.mark.parametrize("seed", range(15))
def test_set_baud_writes_once_on_a_bad_bus(seed: int) -> None:
    line = line_of(sts.STS3215)
    line.servos.faults.disturbance = Disturbance(seed, drop=0.08, flip=0.02)
    assert told(line, set_baud, 3, 500_000).new_baud == 500_000
    assert line.servos.servo(3).baud == 500_000
    assert line.held(3, sts.lock) == 1


# Factory reset and reboot


@every_make
def test_factory_reset_reports_the_changed_settings(model: ServoModel) -> None:
    line = ToolLine({3: model})
    temperature = "max_temperature" if series_of(model).make == "feetech" else "temperature_limit"
    told(line, write_register, 3, temperature, 55)
    report = told(line, factory_reset, 3)
    lost = {was.name: (was.raw, now.raw) for was, now in report.changes}
    assert lost[temperature][0] == 55 != lost[temperature][1]
    expected = 1 if series_of(model).name == "Dynamixel protocol 1.0" else 3
    assert (report.servo_id, report.old_id) == (expected, 3)
    with find_servo(line.port, line.clock, expected) as servo:
        assert servo.port.baud == report.baud


def test_factory_reset_refuses_to_create_a_duplicate_id() -> None:
    line = line_of(ax_mx.AX_12A)
    with pytest.raises(CommissioningError, match="servo 3: a reset would give it ID 1, but another servo"):
        told(line, factory_reset, 3)
    assert sorted(one.servo_id for one in line.servos.servos) == [1, 3]


@every_make
def test_reset_and_reboot_are_refused_while_torque_is_on(model: ServoModel) -> None:
    line = line_of(model)
    switched_on(line, 3)
    for function in (factory_reset, reboot):
        with pytest.raises(CommissioningError, match="because its load falls when the torque is disabled"):
            told(line, function, 3)
    assert line.held(3, series_of(model).torque_enable) == 1


@pytest.mark.parametrize("model", [sts.STS3215, scs.SCS0009, x.XL430_W250], ids=lambda model: model.name)
@pytest.mark.parametrize("held", [False, True])
def test_reboot_waits_until_the_servo_answers_with_torque_off(model: ServoModel, held: bool) -> None:
    line = line_of(model)
    if held:
        switched_on(line, 3)
    report = told(line, reboot, 3, let_go=held)
    assert report.let_go is held
    assert 0.05 <= report.took_s < 2.0
    assert line.held(3, series_of(model).torque_enable) == 0
    assert not line.servos.servo(3).deaf


@pytest.mark.parametrize("model", [ax_mx.AX_12A, ax_mx.MX_28], ids=lambda model: model.name)
def test_reboot_reports_a_servo_without_a_reboot_instruction(model: ServoModel) -> None:
    with pytest.raises(ServoRefused, match="switch its power off and on"):
        told(line_of(model), reboot, 3)
