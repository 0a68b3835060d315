"""Each simulated problem must be the first finding of the doctor, and every recommended command must be valid."""

import shlex
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
import typer

from commissioning.doctor.findings import KINDS
from drivers.servos import sts, x
from servoloop import cli
from tests.commissioning import ailments
from tests.commissioning.patient import Patient

Case = tuple[Callable[[Patient], None], str, str]
FIRST: list[Case] = [
    (ailments.unpowered, "no_power", "scan"),
    (ailments.unplugged_servo, "servo_absent", "scan"),
    (ailments.broken_chain, "chain_broken", ""),
    (ailments.lossy_line, "line_loses", ""),
    (ailments.noisy_line, "line_noisy", ""),
    (ailments.other_rate, "servo_other_rate", "set-baud 3 1000000"),
    (ailments.all_at_another_rate, "wrong_rate", ""),
    (ailments.same_id, "same_id", "set-id 2 NEW"),
    (ailments.factory_id, "id_not_set", "set-id 11 7"),
    (ailments.stranger, "extra_servo", ""),
    (ailments.other_model, "wrong_model", ""),
    (ailments.mute, "servo_mute", ""),
    (ailments.loose_plug, "servo_unsteady", ""),
    (ailments.wheel_mode, "wrong_mode", "--id 3 operating_mode 0"),
    (ailments.odd_phase, "speed_unit", ""),
    (ailments.narrow_limits, "limits_too_narrow", ""),
    (ailments.foreign_offset, "homing_offset_differs", "--id 3 homing_offset 120"),
    (ailments.exchanged_ids, "ids_exchanged", "set-id 2 NEW"),
    (ailments.open_lock, "lock_open", "reboot 3"),
    (ailments.no_acknowledgement, "writes_unacknowledged", "status_level 1"),
    (ailments.lerobots_gains, "gains_differ", ""),
    (ailments.no_gain, "no_gain", "position_p 32"),
    (ailments.wide_dead_zone, "wide_dead_zone", ""),
    (ailments.slow_start, "slow_acceleration", ""),
    (ailments.other_settings, "settings_differ", ""),
    (ailments.no_protection, "protection_off", "register list --port /dev/ttyACM0 --id 7"),
    (ailments.no_torque_allowed, "no_torque_allowed", "max_torque 1000"),
    (ailments.long_delay, "return_delay", "return_delay 0"),
    (ailments.old_firmware, "firmware_differs", ""),
    (ailments.twelve_volts_too_many, "overvoltage", ""),
    (ailments.usb_alone, "undervoltage", ""),
    (ailments.lively_supply, "supply_high", ""),
    (ailments.wrong_voltage_limit, "voltage_limits_wrong", ""),
    (ailments.thin_lead, "voltage_drops", ""),
    (ailments.sagging_supply, "supply_sags", ""),
    (ailments.overload, "alarm_overload", "--id 7 torque_enable 0"),
    (ailments.over_current, "alarm_current", "--id 7 torque_enable 0"),
    (ailments.pressing_gripper, "stalled", ""),
    (ailments.heat, "alarm_temperature", ""),
    (ailments.warmth, "hot", ""),
    (ailments.limp_joint, "torque_lost", ""),
    (ailments.reset_and_driven, "was_reset", ""),
    (ailments.damped, "damped", "torque_enable 0"),
    (ailments.far_outside, "outside_limits", "calibrate"),
    (ailments.full_turn, "travel_differs", "calibrate"),
    (ailments.missed_stop, "travel_differs", "calibrate"),
    (ailments.wrong_pose, "travel_differs", "calibrate"),
    (ailments.over_the_seam, "seam_in_range", "calibrate"),
    (ailments.nobody_calibrated, "not_calibrated", "calibrate"),
    (ailments.denied, "port_denied", ""),
    (ailments.busy, "port_busy", ""),
    (ailments.pulled_plug, "port_lost", ""),
    (ailments.slow_adapter, "slow_round_trip", "ports"),
    (ailments.hub, "servo_late", "ports"),
    (ailments.echoing_adapter, "line_echoes", ""),
]


@pytest.mark.parametrize(("spoil", "kind", "command"), FIRST, ids=[case[0].__name__ for case in FIRST])
def test_the_problem_is_the_first_finding(spoil: Callable[[Patient], None], kind: str, command: str) -> None:
    patient = Patient()
    spoil(patient)
    report = patient.examine()
    assert [finding.id for finding in report.findings][:1] == [kind], report.findings
    first = report.findings[0]
    assert command in (first.command or "")
    assert report.healthy == (first.severity != "fault")
    assert first.severity == KINDS[kind].severity
    for finding in report.findings:
        assert_valid(finding.command or "")


def assert_valid(command: str) -> None:
    """Check that the command line accepts a recommended command, with NEW replaced by a number."""
    words = shlex.split(command.replace("NEW", "9"))
    if words[:1] == ["servoloop"]:
        verb, arguments = verbs()[words[1]], words[2:]
        while hasattr(verb, "commands"):
            verb, arguments = verb.commands[arguments[0]], arguments[1:]
        verb.make_context(words[1], arguments)


@cache
def verbs() -> dict[str, Any]:
    """Return the commands by name."""
    return dict(typer.main.get_command(cli.app).commands)  # type: ignore[attr-defined]


def test_a_dynamixel_arm_is_examined_with_its_own_control_table() -> None:
    patient = Patient("robot_arm_dynamixel")
    patient.put(3, x.operating_mode, 1)
    patient.put(4, x.return_delay, 250)
    patient.line.faults.silence(5)
    found = [(one.id, one.place.servo_id, one.command) for one in patient.examine().findings]
    assert found == [
        ("servo_absent", 5, "servoloop scan /dev/ttyACM0"),
        ("wrong_mode", 3, "servoloop register write --port /dev/ttyACM0 --id 3 operating_mode 3"),
        ("return_delay", 4, "servoloop register write --port /dev/ttyACM0 --id 4 return_delay 0"),
    ]


def test_turns_that_a_limp_dynamixel_drops_at_activation_are_not_a_finding() -> None:
    patient = Patient("robot_arm_dynamixel")
    firmware = patient.line.servo(3).firmware
    firmware._turned -= 2 * 4096
    firmware._place_seam()
    assert patient.examine().findings == ()


def test_a_dynamixel_from_another_program_is_examined_in_extended_position_mode() -> None:
    patient = Patient("robot_arm_dynamixel")
    patient.put(3, x.operating_mode, x.EXTENDED_POSITION_MODE)
    patient.line.servo(3).firmware._turned -= 3 * 4096
    patient.line.servo(3).firmware._place_seam()
    assert patient.examine().findings == ()


def test_gains_that_another_program_left_in_ram_are_found() -> None:
    patient = Patient("koch")
    for servo_id, register, value in ((6, x.position_p_gain, 20), (2, x.position_i_gain, 3000)):
        patient.put(servo_id, register, value)
        patient.line.servo(servo_id).firmware.load_goal()
    found = [one for one in patient.examine().findings if one.id == "gains_left"]
    assert [(one.place.servo_id, one.command) for one in found] == [
        (2, "servoloop reboot 2 --port /dev/ttyACM0"),
        (6, "servoloop reboot 6 --port /dev/ttyACM0"),
    ]
    assert "position_i_gain is 3000, not 0" in found[0].cause
    assert "position_p_gain is 20, not 400" in found[1].cause


def test_a_wrong_dynamixel_voltage_limit_is_found() -> None:
    patient = Patient("robot_arm_dynamixel")
    patient.put(2, x.max_voltage_limit, 110)
    patient.wait(0.5)
    findings = patient.findings()
    assert findings["voltage_limits_wrong"].command == (
        "servoloop register write --port /dev/ttyACM0 --id 2 max_voltage_limit 150"
    )
    assert "alarm_voltage" not in findings, "it is explained by the limit"


def test_no_command_raises_a_voltage_limit_that_may_belong_to_another_version_of_the_servo() -> None:
    patient = Patient("so101_12v")
    patient.put(3, sts.max_voltage, 80)
    patient.wait(0.2)
    found = patient.findings()["voltage_limits_wrong"]
    assert found.command is None and found.place.servo_id == 3
    assert "The servo may be the 7.4 V version of the sts3215: switch the supply off and read its label" in found.cause


@pytest.mark.parametrize(("arm", "volts", "kind"), [("so101", 12.0, "overvoltage"), ("so101_12v", 7.4, "undervoltage")])
def test_a_wrong_supply_is_reported_once_and_may_be_a_wrong_arm(arm: str, volts: float, kind: str) -> None:
    patient = Patient(arm)
    ailments.feed(patient.line, volts)
    patient.wait(0.2)
    (found,) = [one for one in patient.examine().findings if one.id == kind]
    assert (found.place.joint, found.command) == (None, None)
    assert "shoulder_pan (servo 1), " in found.cause and "gripper (servo 6) have" in found.cause
    assert "the wrong --arm, or the wrong model in the robot file, is selected" in found.cause
