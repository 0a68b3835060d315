"""Tests that settings of the robot file are written to the EEPROM once and logged, and that nothing else is written."""

import logging
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.driver_errors import DriverError
from drivers.eeprom import OPEN
from drivers.servos import sts
from drivers.servos.catalog import MODELS
from drivers.servos.register import Register
from hal.compensation.servo_compliance import compliance_of
from hal.hal_errors import RobotFileError
from hal.robot_file.robot_file import load_robot_file
from hal.servos.servo_settings import NOT_SETTINGS, settings_of
from servoloop.stack.shipped_files import CONFIG
from tests.hal.bench import JOINTS, Bench

SOFT = (("position_p", 16), ("ccw_dead_zone", 2), ("acceleration_multiplier", 2))
NAMED = (replace(JOINTS[0], settings=SOFT), *JOINTS[1:])
WRITE = 3


def settings_written(bench: Bench) -> list[tuple[int, int]]:
    """Return the ID and the address of each write to a persistent register."""
    saved = {register.address for register in sts.REGISTERS if register.persistent}
    return [(i.servo_id, i.parameters[0]) for i in bench.port.sent if i.code == WRITE and i.parameters[0] in saved]


def test_different_settings_are_written_logged_and_locked(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench(joints=NAMED)
    with caplog.at_level(logging.INFO):
        bench.configured()
    held = [bench.held(1, register) for register in (sts.position_p, sts.ccw_dead_zone, sts.acceleration_multiplier)]
    assert held == [16, 2, 2]
    assert bench.held(1, sts.lock) != OPEN
    assert bench.torque() == []
    assert "shoulder (servo 1): position_p set to 16 (was 32)" in caplog.messages
    assert {servo_id for servo_id, _ in settings_written(bench)} == {1}
    bench.servos.servo(1).power_cycle()
    assert bench.held(1, sts.position_p) == 16, "saved, not only held"


def test_settings_that_a_servo_already_has_are_not_written() -> None:
    bench = Bench(joints=NAMED).configured()
    bench.hardware.cleanup()
    bench.configured()
    assert settings_written(bench) == []


def test_settings_are_not_written_to_a_servo_with_torque() -> None:
    bench = Bench(joints=NAMED)
    bench.servos.servo(1).memory.put(sts.torque_enable, 1)
    with pytest.raises(
        DriverError, match=r"servo 1\b.*position_p .*the torque of the servo is enabled. Support the arm"
    ):
        bench.configured()
    assert bench.held(1, sts.position_p) == 32
    assert bench.torque() == [1]


def test_a_failure_reports_the_settings_written_before_it() -> None:
    bench = Bench(joints=(replace(JOINTS[0], settings=(("max_temperature", 60), ("position_p", 16))), *JOINTS[1:]))
    memory = bench.servos.servo(1).memory
    bench.port.before_write = lambda number, instruction: memory.put(sts.position_p, 32)
    with pytest.raises(DriverError) as caught:
        bench.configured()
    assert bench.held(1, sts.max_temperature) == 60
    assert str(caught.value) == (
        "shoulder: servo 1: position_p (register 21) is still 32, not 16: the servo did not accept the value; "
        "written before this error: max_temperature 70 to 60"
    )


def test_nothing_is_written_while_a_servo_is_missing() -> None:
    bench = Bench(joints=NAMED)
    bench.servos.faults.silence(7)
    with pytest.raises(DriverError, match="servo 7"):
        bench.configured()
    assert settings_written(bench) == []


@pytest.mark.parametrize(
    ("register", "value", "named", "expected"),
    [
        (sts.position_p, 16, (), "settings: {position_p: 16}"),
        (sts.max_acceleration, 50, (), "settings: {max_acceleration: 50}"),
        (sts.position_p, 16, (("position_p", 16),), ""),
        (sts.max_acceleration, 254, (), ""),
        (sts.position_d, 0, (), ""),
    ],
    ids=["softer", "slower", "named", "faster than its goal speed", "no effect"],
)
def test_gains_unknown_to_the_compensation_are_logged(
    register: Register,
    value: int,
    named: tuple[tuple[str, int], ...],
    expected: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Bench(joints=(replace(JOINTS[0], settings=named), *JOINTS[1:]))
    bench.servos.servo(1).memory.put(register, value)
    with caplog.at_level(logging.WARNING):
        bench.configured()
    warnings = [record.getMessage() for record in caplog.records]
    assert [expected in warning and "shoulder (servo 1)" in warning for warning in warnings] == (
        [True] if expected else []
    )


def test_the_compensation_uses_the_gains_of_the_robot_file() -> None:
    factory, soft = compliance_of(sts.STS3215), NAMED[0].compliance
    assert factory is not None and soft is not None
    assert soft.stiffness == pytest.approx(factory.stiffness / 2.0)
    assert soft.dead_band == pytest.approx(factory.dead_band * 1.5)
    slow = compliance_of(sts.STS3215, settings={"max_acceleration": 50})
    assert slow is not None and slow.profile_acceleration == pytest.approx(factory.profile_acceleration / 2.0)
    assert compliance_of(sts.STS3215, settings={"position_p": 0}) is None


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("{position_q: 1}", "joint1.settings: sts3215 has no setting position_q: it has "),
        ("{position_p: 256}", "joint1.settings: position_p must be 0 to 254, not 256"),
        ("{id: 3}", "joint1.settings: sts3215 has no setting id"),
        ("{angular_resolution: 2}", "joint1.settings: sts3215 has no setting angular_resolution"),
        ("{present_position: 3}", "joint1.settings: sts3215 has no setting present_position"),
    ],
)
def test_unknown_settings_are_reported_before_anything_is_sent(tmp_path: Path, settings: str, message: str) -> None:
    path = tmp_path / "robot.yaml"
    text = (CONFIG / "robot_arm.yaml").read_text()
    path.write_text(text.replace("servo_id: 1,", f"servo_id: 1, settings: {settings},"))
    with pytest.raises(RobotFileError) as caught:
        load_robot_file(path)
    assert message in str(caught.value)


@pytest.mark.parametrize("name", sorted(MODELS))
def test_address_and_mode_registers_are_not_settings(name: str) -> None:
    assert not NOT_SETTINGS & settings_of(MODELS[name]).keys()
    assert "control_mode" not in settings_of(MODELS[name])
    assert "max_temperature" in settings_of(MODELS[name]) or "temperature_limit" in settings_of(MODELS[name])


def test_a_servo_with_another_homing_offset_is_refused() -> None:
    joints = (replace(JOINTS[0], homing_offset=0), replace(JOINTS[1], homing_offset=120), JOINTS[2])
    bench = Bench(joints=joints)
    with pytest.raises(DriverError) as caught:
        bench.configured()
    assert str(caught.value).startswith(
        "elbow: servo 2: has homing_offset 0, but elbow was calibrated with 120: was the servo replaced or reset?"
    )


def test_an_unusual_speed_unit_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench(joints=NAMED)
    bench.servos.servo(1).memory.put(sts.phase, 0)
    with caplog.at_level(logging.WARNING):
        bench.configured()
    assert caplog.text.count("servo 1: phase (register 18) is 0") == 1
