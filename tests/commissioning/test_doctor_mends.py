"""The command that the doctor recommends fixes the problem, so the finding disappears."""

import shlex
from collections.abc import Callable
from typing import Any

import pytest

from commissioning.registers.access import write_register
from commissioning.registers.address import reboot, set_baud, set_id
from commissioning.scan.find import find_servo
from tests.commissioning import ailments
from tests.commissioning.patient import Patient

MENDED: list[tuple[Callable[[Patient], None], str]] = [
    (ailments.other_rate, "servo_other_rate"),
    (ailments.factory_id, "id_not_set"),
    (ailments.wheel_mode, "wrong_mode"),
    (ailments.foreign_offset, "homing_offset_differs"),
    (ailments.open_lock, "lock_open"),
    (ailments.no_acknowledgement, "writes_unacknowledged"),
    (ailments.no_gain, "no_gain"),
    (ailments.long_delay, "return_delay"),
    (ailments.overload, "alarm_overload"),
    (ailments.damped, "damped"),
]


def run(patient: Patient, command: str) -> None:
    """Apply the effect of a command in simulated time."""
    verb, *words = shlex.split(command)[1:]
    of_id: dict[str, Callable[..., Any]] = {"set-id": set_id, "set-baud": set_baud, "reboot": reboot}
    if verb in of_id:
        servo_id, arguments = int(words[0]), [int(word) for word in words[1 : words.index("--port")]]
        with find_servo(patient.open("", 1_000_000), patient.clock, servo_id) as servo:
            of_id[verb](servo, *arguments)
        return
    assert (verb, words[0]) == ("register", "write")
    servo_id, (name, value) = int(words[words.index("--id") + 1]), words[-2:]
    with find_servo(patient.open("", 1_000_000), patient.clock, servo_id) as servo:
        write_register(servo, name, value, torque=name == "torque_enable")


@pytest.mark.parametrize(("spoil", "kind"), MENDED, ids=[case[0].__name__ for case in MENDED])
def test_the_recommended_command_fixes_the_problem(spoil: Callable[[Patient], None], kind: str) -> None:
    patient = Patient()
    spoil(patient)
    first = patient.examine().findings[0]
    assert first.id == kind and first.command
    run(patient, first.command)
    patient.wait(0.2)
    found = patient.findings()
    assert kind not in found
    assert {one.id for one in found.values() if one.severity == "fault"} <= {"torque_lost"}, found


def test_servos_are_healthy_after_their_power_returns() -> None:
    patient = Patient()
    ailments.unpowered(patient)
    assert list(patient.findings()) == ["no_power"]
    ailments.feed(patient.line, 12.0)
    patient.wait(1.0)
    assert patient.examine().findings == ()
