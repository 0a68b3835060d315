"""The doctor's motion test finds wrong gears, sag, oscillation and weak supplies, and then releases the arm."""

from collections.abc import Callable
from typing import Any

import pytest

from commissioning.doctor.motion import FASTEST_RAD_S, SmallMotions
from commissioning.doctor.report import DoctorReport
from commissioning.slow_arm import SPEED_SHARE
from drivers.servos import sts
from hal.compensation.gravity import Gravity
from sim_backend.buses.build import Build
from tests.commissioning import ailments
from tests.commissioning.patient import Patient

pytestmark = pytest.mark.slow

GEARS = {"1:191": 345 / 191, "1:147": 345 / 147}
PAN = 1
LIFT = 2


def examine(patient: Patient, stopped: Callable[[], bool] = lambda: False) -> DoctorReport:
    gravity = Gravity(patient.files.description, [joint.name for joint in patient.robot.joints])
    return patient.examine(SmallMotions(patient.open, patient.clock, gravity, stopped))


def found(report: DoctorReport) -> list[tuple[str, int | None]]:
    return [(one.id, one.place.servo_id) for one in report.findings]


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["robot_arm", "so101"])
def test_healthy_arms_have_no_motion_findings_and_are_released(arm: str) -> None:
    for seed in range(4):
        patient = Patient(arm, Build(1.0, seed))
        before = [servo.memory.read(4, 36) for servo in patient.line.servos]
        assert examine(patient).findings == (), seed
        assert not any(servo.memory.get(sts.torque_enable) for servo in patient.line.servos)
        assert [servo.memory.read(4, 36) for servo in patient.line.servos] == before


@pytest.mark.parametrize(
    ("gear", "servo_id", "seed"), [("1:191", 5, None), ("1:191", 7, 1), ("1:147", 5, 1), ("1:147", 7, None)]
)
def test_a_wrong_gear_in_a_joint_is_found(gear: str, servo_id: int, seed: int | None) -> None:
    """Gears can be identified only in the wrist and the hand. The motion of other joints moves too much of the arm."""
    patient = Patient(build=Build(seed=seed))
    states = patient.line.servo(servo_id).firmware._states
    for constant in ("torque_constant_nm_a", "back_emf_v_s"):
        states[constant] /= GEARS[gear]
    assert found(examine(patient)) == [("wrong_gear", servo_id)]


def test_a_joint_that_sags_too_much_is_found() -> None:
    patient = Patient()
    patient.put(LIFT, sts.position_p, 5)
    report = examine(patient)
    assert ("gives_way", LIFT) in found(report)
    assert report.healthy


def test_a_joint_that_shakes_is_found() -> None:
    """Gravity must not hold the joint at one end of its backlash."""
    patient = Patient(build=Build(backlash_deg=3.0))
    patient.put(PAN, sts.position_p, 254)
    patient.put(PAN, sts.position_d, 0)
    shakes = next(one for one in examine(patient).findings if (one.id, one.place.servo_id) == ("shakes", PAN))
    assert shakes.command == "servoloop register write --port /dev/ttyACM0 --id 1 position_p 16"


def test_a_blocked_joint_is_found() -> None:
    patient = Patient()
    ailments.block(patient, ailments.ELBOW)
    report = examine(patient)
    assert found(report)[0] == ("does_not_move", ailments.ELBOW)
    assert not report.healthy


def test_a_supply_that_sags_during_motion_is_found() -> None:
    patient = Patient()
    joints = patient.plant.joints

    def weaken(time_s: float) -> None:
        fastest = max(abs(joints.velocity[at]) for at in joints.velocity_at)
        patient.line.rig.feed(9.5 if fastest > 0.2 else 12.0)

    patient.plant._after_step = weaken
    patient.wait(4.0)  # the limp arm sinks first
    assert ("supply_sags", None) in found(examine(patient))


def test_an_arm_under_torque_or_with_faults_is_not_moved() -> None:
    held = Patient()
    held.hold()
    faulty = Patient()
    ailments.wheel_mode(faulty)
    for patient, why in ((held, "have torque enabled, and the arm may fall"), (faulty, "because there are faults")):
        before = [servo.memory.get(sts.goal_position) for servo in patient.line.servos]
        report = examine(patient)
        (finding,) = (one for one in report.findings if one.id == "not_moved")
        assert why in finding.cause
        assert [servo.memory.get(sts.goal_position) for servo in patient.line.servos] == before
    assert all(servo.memory.get(sts.torque_enable) for servo in held.line.servos)


def test_stopping_the_motion_test_releases_the_arm() -> None:
    patient = Patient()
    start_s = patient.clock.now()
    report = examine(patient, lambda: patient.clock.now() > start_s + 8.0)
    assert [one.id for one in report.findings] == ["not_moved"]
    assert not any(servo.memory.get(sts.torque_enable) for servo in patient.line.servos)


def test_a_port_lost_during_the_motion_test_is_reported() -> None:
    patient = Patient()
    opened: list[Any] = []
    open_port = patient.open

    def open_and_pull(device: str, baud: int) -> Any:
        port = open_port(device, baud)
        opened.append(port)
        if len(opened) == 2:
            write, end_s = port.write, patient.clock.now() + 6.0

            def pulled(data: bytes) -> None:
                if patient.clock.now() > end_s:
                    port.unplug()
                write(data)

            port.write = pulled
        return port

    patient.open = open_and_pull  # type: ignore[method-assign]
    report = examine(patient)
    assert [one.id for one in report.findings] == ["motion_failed"]
    assert "was unplugged" in report.findings[0].cause
    assert not report.healthy


def silence_in_motion(patient: Patient, servo_id: int) -> None:
    """Silence a servo 20 s after its torque was enabled."""
    memory, until = patient.line.servo(servo_id).memory, list[float]()

    def reaches(asked: int) -> bool:
        if memory.get(sts.torque_enable) and not until:
            until.append(patient.clock.now() + 20.0)
        return asked != servo_id or not until or patient.clock.now() < until[0]

    patient.line.faults.on_instruction.append(reaches)


def test_a_servo_that_keeps_its_torque_is_a_fault() -> None:
    patient = Patient()
    silence_in_motion(patient, 3)
    report = examine(patient)
    assert patient.line.servo(3).memory.get(sts.torque_enable) == 1
    assert [one.id for one in report.findings] == ["motion_failed"]
    assert "torque may still be on: servo 3: does not respond" in report.findings[0].cause
    assert not report.healthy


def test_a_failure_hides_no_joint_that_was_measured_before() -> None:
    patient = Patient()
    ailments.block(patient, PAN)
    silence_in_motion(patient, 5)
    assert found(examine(patient)) == [("motion_failed", None), ("does_not_move", PAN)]


def test_a_failed_activation_is_a_fault() -> None:
    patient = Patient()
    first = patient.line.servo(1).memory
    patient.line.faults.on_instruction.append(lambda asked: asked != 3 or not first.get(sts.torque_enable))
    report = examine(patient)
    assert [one.id for one in report.findings] == ["motion_failed"] and not report.healthy
    assert "servo 3: does not respond" in report.findings[0].cause


def test_a_failed_activation_that_leaves_torque_on_is_a_fault_even_after_a_request_to_stop() -> None:
    patient = Patient()
    third = patient.line.servo(3).memory
    patient.line.faults.on_instruction.append(lambda asked: asked != 3 or not third.get(sts.torque_enable))
    report = examine(patient, lambda: bool(third.get(sts.torque_enable)))
    assert third.get(sts.torque_enable) == 1
    assert [one.id for one in report.findings] == ["motion_failed"] and not report.healthy
    assert "torque may still be on: servo 3: does not respond" in report.findings[0].cause


def test_a_motion_test_that_is_stopped_before_it_begins_is_a_note() -> None:
    report = examine(Patient(), lambda: True)
    assert [one.id for one in report.findings] == ["not_moved"]
    assert "the arm was not moved" in report.findings[0].cause


def test_no_joint_is_faster_than_tools_may_be() -> None:
    patient = Patient()
    fastest = [0.0] * len(patient.robot.joints)

    first = patient.line.servo(1).memory

    def watch(time_s: float) -> None:
        if first.get(sts.torque_limit) < 999 or not first.get(sts.torque_enable):
            return  # the arm is limp before the test, or is lowered after it
        for at, joint in enumerate(patient.plant.joints.velocity_at):
            fastest[at] = max(fastest[at], abs(float(patient.plant.joints.velocity[joint])))

    patient.plant._after_step = watch
    examine(patient)
    for joint, speed in zip(patient.robot.joints, fastest, strict=True):
        allowed = min(SPEED_SHARE * joint.limits.velocity, FASTEST_RAD_S * joint.transmission)
        assert 0.2 * allowed < speed < 1.6 * allowed, joint.name
