"""Healthy arms with different tolerances and backlash have no findings, with torque on and off."""

import pytest

from servoloop.stack.arm_folders import arms
from sim_backend.buses.build import Build
from tests.commissioning.patient import Patient
from tests.drivers.fault_lines import CYCLES

SEEDS = range(50 if CYCLES > 1000 else 10)
"""Seeds of the arms; ``make soak`` runs fifty."""
FIFTY = ("robot_arm", "so101")
OTHERS = [arm.name for arm in arms() if arm.name not in FIFTY]


@pytest.mark.soak
@pytest.mark.parametrize("holding", [False, True], ids=["limp", "holding"])
@pytest.mark.parametrize("arm", FIFTY)
def test_fifty_healthy_arms_have_no_findings(arm: str, holding: bool) -> None:
    for seed in SEEDS:
        patient = Patient(arm, Build(backlash_deg=seed % 2 * 1.0, seed=seed))
        if holding:
            patient.hold()
        report = patient.examine()
        assert report.findings == (), f"seed {seed}"
        assert report.healthy


@pytest.mark.parametrize("holding", [False, True], ids=["limp", "holding"])
@pytest.mark.parametrize("arm", OTHERS)
def test_healthy_arms_of_other_makes_and_voltages_have_no_findings(arm: str, holding: bool) -> None:
    patient = Patient(arm, Build(seed=1))
    if holding:
        patient.hold()
    assert patient.examine().findings == ()


def test_an_unpowered_bus_of_two_is_named() -> None:
    patient = Patient("robot_arm_two_buses.yaml")
    assert patient.examine().findings == ()
    for servo in patient.lines["hand"].servos:
        patient.lines["hand"].faults.silence(servo.servo_id)
    (finding,) = patient.examine().findings
    assert (finding.id, finding.place.bus) == ("no_power", "hand")


def test_the_bus_is_named_in_the_recommended_calibration_of_two_buses() -> None:
    finding = Patient("robot_arm_two_buses.yaml", calibrated=False).findings()["not_calibrated"]
    assert finding.command == "servoloop calibrate --arm NAME --port arm=/dev/ttyACM0-arm"


def test_the_doctor_writes_nothing_and_keeps_the_torque() -> None:
    for holding in (False, True):
        patient = Patient()
        if holding:
            patient.hold()
        before = [servo.memory.read(0, 56) for servo in patient.line.servos]
        patient.examine()
        assert [servo.memory.read(0, 56) for servo in patient.line.servos] == before


def test_the_doctor_takes_seconds_even_with_silent_servos() -> None:
    patient = Patient()
    for servo in patient.line.servos:
        patient.line.faults.silence(servo.servo_id)
    start_s = patient.clock.now()
    patient.examine()
    assert patient.clock.now() - start_s < 30.0
