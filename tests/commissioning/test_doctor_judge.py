"""Findings from snapshots that virtual servos cannot produce."""

from dataclasses import replace

import pytest

from commissioning.doctor.doctor import judge
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, LineFigures, ServoSnapshot
from drivers.types import ServoState
from tests.commissioning.patient import files_of, perfect

STS = files_of("robot_arm").robot.joints[0]
DYNAMIXEL = files_of("robot_arm_dynamixel").robot.joints[0]
STATE = ServoState(2048, 0, 0.0, 12.0, 30.0)
LINE = LineFigures(700, 0, 0, 0, 0, 0.0002, 0.00015)
BUS = BusSnapshot("", "/dev/ttyACM0", 1_000_000, (ServoSnapshot(STS, "well", {}, (STATE,), "/dev/ttyACM0"),), (), LINE)


def ids(bus: BusSnapshot) -> list[str]:
    return [one.id for one in judge(ArmSnapshot((bus,), perfect((STS,))))]


def test_healthy_snapshots_have_no_findings() -> None:
    assert ids(BUS) == []


@pytest.mark.parametrize(
    ("alarms", "kind", "command"),
    [
        (("voltage",), "alarm_voltage", "register list"),
        (("angle sensor",), "alarm_other", None),
        (("overload",), "alarm_overload", "torque_enable 0"),
    ],
)
def test_an_alarm_in_a_single_state_is_found(alarms: tuple[str, ...], kind: str, command: str | None) -> None:
    servo = replace(BUS.servos[0], states=(STATE, STATE._replace(alarms=alarms), STATE))
    (finding,) = judge(ArmSnapshot((replace(BUS, servos=(servo,)),), perfect((STS,))))
    assert finding.id == kind
    assert command in finding.command if command and finding.command else finding.command is None


def test_a_low_supply_is_found() -> None:
    pan = files_of("so101").robot.joints[0]
    servo = ServoSnapshot(pan, "well", {}, (STATE._replace(voltage_v=5.0),), "/dev/ttyACM0")
    findings = judge(ArmSnapshot((replace(BUS, servos=(servo,)),), perfect((pan,))))
    assert [(one.id, one.severity) for one in findings] == [("supply_low", "warning")]


def test_a_dynamixel_alarm_is_cleared_by_a_reboot() -> None:
    servo = ServoSnapshot(DYNAMIXEL, "well", {}, (STATE._replace(alarms=("overload",)),), "/dev/ttyUSB0")
    findings = judge(ArmSnapshot((replace(BUS, servos=(servo,)),), perfect((DYNAMIXEL,))))
    assert [(one.id, one.command) for one in findings] == [
        ("alarm_overload", f"servoloop reboot {DYNAMIXEL.servo_id} --port /dev/ttyUSB0")
    ]


def test_late_replies_are_found() -> None:
    assert ids(replace(BUS, line=replace(LINE, late=20))) == ["line_late"]


@pytest.mark.parametrize("figure", ["lost", "corrupt", "late", "noise"])
def test_a_single_lost_reply_is_not_a_finding(figure: str) -> None:
    assert ids(replace(BUS, line=replace(LINE, **{figure: 1}))) == []


def test_an_adapter_that_does_not_support_the_rate_is_found() -> None:
    text = "/dev/ttyUSB0 runs at 923076 baud instead of 1000000, which its adapter does not support"
    (finding,) = judge(
        ArmSnapshot((BusSnapshot("", "/dev/ttyUSB0", 1_000_000, problem="unsuitable", problem_text=text),))
    )
    assert (finding.id, finding.severity, finding.cause) == ("port_unsuitable", "fault", text)


def test_a_port_that_is_not_serial_is_found() -> None:
    bus = BusSnapshot("", "/tmp/x", 1_000_000, problem="not_serial", problem_text="/tmp/x is not a serial device")
    (finding,) = judge(ArmSnapshot((bus,)))
    assert (finding.id, finding.symptom) == ("port_not_serial", "/tmp/x: the port is not a serial device")


def test_a_counted_turn_is_not_reported_as_a_wrong_zero() -> None:
    servo = replace(BUS.servos[0], states=(STATE._replace(position_counts=6144),))
    (finding,) = judge(ArmSnapshot((replace(BUS, servos=(servo,)),), perfect((STS,))))
    assert finding.id == "turn_counted" and finding.command is None
    assert "it has counted a turn. Hold the arm, and switch the servos' supply off and on" in finding.cause


def test_a_long_return_delay_is_not_reported_as_a_slow_adapter() -> None:
    assert ids(replace(BUS, line=replace(LINE, round_trip_s=0.006))) == ["slow_round_trip"]
    assert ids(replace(BUS, line=replace(LINE, round_trip_s=0.0025, delay_s=0.0005))) == []


@pytest.mark.parametrize(("extended", "mode"), [(True, 4), (False, 3), (True, 3), (False, 4)])
def test_a_dynamixel_in_another_mode_than_calibrated_is_found(extended: bool, mode: int) -> None:
    joint = replace(DYNAMIXEL, extended=extended, homing_offset=0)
    registers = {"model_number": joint.model.number, "operating_mode": mode, "drive_mode": 0}
    if extended:  # the servo ignores these limits in extended position mode
        registers |= {"min_position_limit": 1000, "max_position_limit": 1100}
    servo = ServoSnapshot(joint, "well", registers, (STATE,), "/dev/ttyUSB0")
    found = judge(ArmSnapshot((replace(BUS, servos=(servo,)),), perfect((joint,))))
    right = 4 if extended else 3
    command = f"servoloop register write --port /dev/ttyUSB0 --id {joint.servo_id} operating_mode {right}"
    assert [(one.id, one.command) for one in found] == ([] if mode == right else [("wrong_mode", command)])


def test_gains_that_another_program_left_are_found() -> None:
    registers = {"model_number": DYNAMIXEL.model.number, "position_i_gain": 3000, "feedforward_1st_gain": 0}
    servo = ServoSnapshot(DYNAMIXEL, "well", registers, (STATE,), "/dev/ttyUSB0")
    (found,) = judge(ArmSnapshot((replace(BUS, servos=(servo,)),), perfect((DYNAMIXEL,))))
    assert (found.id, found.severity) == ("gains_left", "warning")
    assert "position_i_gain is 3000, not 0" in found.cause and "feedforward" not in found.cause
    wanted = replace(DYNAMIXEL, settings=(("position_i_gain", 3000),))
    assert judge(ArmSnapshot((replace(BUS, servos=(replace(servo, joint=wanted),)),), perfect((wanted,)))) == ()


def test_a_servo_that_answers_only_single_reads_is_found() -> None:
    servo = ServoSnapshot(DYNAMIXEL, "well", {"status_return_level": 2}, (STATE,), "/dev/ttyUSB0", alone=True)
    (found,) = judge(ArmSnapshot((replace(BUS, servos=(servo,)),), perfect((DYNAMIXEL,))))
    assert (found.id, found.severity, found.command) == ("no_group_reads", "warning", None)
    assert "status_return_level (register 68) is 2, so this is not a setting" in found.cause
