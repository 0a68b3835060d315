"""A healthy arm gets no complaint: fifty arms of differing parts, limp and under torque, with and without backlash."""

import pytest

from servoloop.stack.arm_folders import arms
from sim_backend.buses.build import Build
from tests.commissioning.patient import Patient
from tests.drivers.fault_lines import CYCLES

SEEDS = range(50 if CYCLES > 1000 else 10)
"""Fifty in make soak."""
FIFTY = ("robot_arm", "so101")
OTHERS = [arm.name for arm in arms() if arm.name not in FIFTY]


@pytest.mark.soak
@pytest.mark.parametrize("holding", [False, True], ids=["limp", "holding"])
@pytest.mark.parametrize("arm", FIFTY)
def test_fifty_healthy_arms(arm: str, holding: bool) -> None:
    for seed in SEEDS:
        patient = Patient(arm, Build(backlash_deg=seed % 2 * 1.0, seed=seed))
        if holding:
            patient.hold()
        report = patient.examine()
        assert report.findings == (), f"seed {seed}"
        assert report.healthy


@pytest.mark.parametrize("holding", [False, True], ids=["limp", "holding"])
@pytest.mark.parametrize("arm", OTHERS)
def test_other_makes_and_voltages(arm: str, holding: bool) -> None:
    patient = Patient(arm, Build(seed=1))
    if holding:
        patient.hold()
    assert patient.examine().findings == ()


def test_a_robot_with_two_buses_and_one_without_power() -> None:
    patient = Patient("robot_arm_two_buses.yaml")
    assert patient.examine().findings == ()
    for servo in patient.lines["hand"].servos:
        patient.lines["hand"].faults.silence(servo.servo_id)
    (finding,) = patient.examine().findings
    assert (finding.id, finding.place.bus) == ("no_power", "hand")


def test_nothing_is_written_and_torque_stays() -> None:
    for holding in (False, True):
        patient = Patient()
        if holding:
            patient.hold()
        before = [servo.memory.read(0, 56) for servo in patient.line.servos]
        patient.examine()
        assert [servo.memory.read(0, 56) for servo in patient.line.servos] == before


def test_it_takes_seconds_however_silent_the_servos_are() -> None:
    patient = Patient()
    for servo in patient.line.servos:
        patient.line.faults.silence(servo.servo_id)
    start_s = patient.clock.now()
    patient.examine()
    assert patient.clock.now() - start_s < 30.0
