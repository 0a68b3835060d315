"""Dynamixel models that are recognized by name only, and models with two servos in one case."""

from dataclasses import replace

import pytest

from commissioning.doctor.doctor import judge
from commissioning.doctor.findings import Finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, ServoSnapshot
from drivers.bus.bus import Bus
from drivers.driver_errors import ServoRefused
from drivers.servos import x
from drivers.servos.catalog import UNSUPPORTED, known_as
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS
from tests.commissioning.lines import ToolLine
from tests.commissioning.patient import files_of, perfect
from tests.commissioning.test_doctor_judge import BUS, STATE

JOINT = files_of("robot_arm_dynamixel").robot.joints[0]


def judged(servo: ServoSnapshot, *others: ServoSnapshot) -> list[Finding]:
    bus: BusSnapshot = replace(BUS, servos=(servo, *others))
    return list(judge(ArmSnapshot((bus,), perfect(tuple(one.joint for one in bus.servos)))))


def test_the_sdk_lists_the_same_numbers() -> None:
    import importlib.resources

    table = importlib.resources.files("dynamixel_easy_sdk") / "control_table" / "dynamixel.model"
    rows = [line.split("\t") for line in table.read_text(encoding="utf-8").splitlines()[1:] if "\t" in line]
    theirs = {int(number): name.strip().removesuffix(".model").replace("_", "-").upper() for number, name in rows}
    supported = {model.number for model in x.MODELS.values()} | {350}
    assert {number: name for number, name in theirs.items() if number not in supported} == dict(UNSUPPORTED)


def test_a_servo_without_a_supported_table_is_named() -> None:
    assert known_as(2010, X) == "PH54-100-S500"
    assert known_as(4000, X) == "YM070-210-M001"
    assert known_as(2010, STS) == "unknown"


def test_a_scan_names_a_servo_without_a_supported_table() -> None:
    line = ToolLine({1: x.XM430_W350})
    line.servos.servo(1).memory.put(x.model_number, 2010)
    (servo,) = line.scan().servos
    (problem,) = [one for one in servo.problems if one.kind == "unknown_model"]
    assert problem.text.startswith("PH54-100-S500: read only, because its control table is not supported")


def test_both_models_of_a_wrong_servo_are_named() -> None:
    line = ToolLine({1: x.XM430_W350})
    line.servos.servo(1).memory.put(x.model_number, 2010)
    bus = Bus(line.port, line.clock, {1: x.XM430_W350})
    with pytest.raises(ServoRefused, match=r"is model 2010 \(PH54-100-S500\), not 1020 \(xm430-w350\)"):
        bus.identify(1, x.XM430_W350)


def test_the_doctor_names_a_servo_without_a_supported_table() -> None:
    (found,) = judged(ServoSnapshot(JOINT, "well", {"model_number": 2010}, (STATE,), "/dev/ttyUSB0"))
    assert found.id == "wrong_model"
    assert "2010 (PH54-100-S500; its control table is not supported, so it can only be read)" in found.cause


def test_the_doctor_reports_that_a_pair_has_two_ids() -> None:
    pair = replace(JOINT, model=x.TWO_XL430_W250)
    silent = ServoSnapshot(pair, "silent", {}, (), "/dev/ttyUSB0")
    other = ServoSnapshot(replace(pair, name="other", servo_id=99), "well", {}, (STATE,), "/dev/ttyUSB0")
    (found,) = [one for one in judged(silent, other) if one.id == "servo_absent"]
    assert "A 2xl430-w250 is two servos in one case with one cable, and each has its own ID" in found.cause
