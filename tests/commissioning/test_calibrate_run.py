"""The whole calibration, as the command line and scripts call it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from commissioning.calibrate.flow import Task
from commissioning.calibrate.result import CalibrationError
from commissioning.calibrate.run import HOLD, LET_GO, STORE, TRY, Difference, calibrate
from commissioning.slow_arm import StoppedError
from drivers.errors import PortLost, ServoRefused, ServoSilent
from drivers.servos import sts
from hal.robot_file.calibration_file import calibration_path
from hal.servos.limp_arm import release_question
from servoloop.files import CONFIG, read_files
from tests.commissioning.arm import JOINTS, PLAN, Person, UnalignedArm

SEED = 5


@dataclass
class Owner(Person):
    """A person who also decides."""

    no: tuple[str, ...] = ()
    asked: list[str] = field(default_factory=list)
    shown: list[Difference] = field(default_factory=list)

    def confirm(self, question: str) -> bool:
        self.asked.append(question)
        return question not in self.no

    def say(self, text: str) -> None:
        super().say(text)
        if text == LET_GO:
            assert torque(self.arm) == [joint.servo_id for joint in JOINTS], "it is let go when it holds itself"
            self.arm.hand.release()
        if text == HOLD:
            assert torque(self.arm), "it is taken before it is limp"
            self.arm.hand.hold()

    def show(self, differences: tuple[Difference, ...]) -> None:
        self.shown = list(differences)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text((CONFIG / "robot_arm.yaml").read_text())
    return path


def torque(arm: UnalignedArm) -> list[int]:
    return [servo.servo_id for servo in arm.line.servos if servo.memory.get(sts.torque_enable)]


@pytest.mark.slow
def test_from_an_unaligned_arm_to_a_file_that_brings_it_up_and_again_without_a_difference(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm)
    outcome = calibrate(robot, JOINTS, PLAN.joints, lambda: arm.open_bus(JOINTS), owner, arm.clock)
    assert outcome.stored and outcome.tried and owner.asked == [STORE, TRY]
    assert [difference.doubt for difference in owner.shown] == [""] * len(JOINTS)
    assert torque(arm) == [] and arm.hand.holds(JOINTS[0].name)
    joints = read_files(robot=robot).robot.joints
    again = calibrate(robot, joints, PLAN.joints, lambda: arm.open_bus(joints), Owner(arm), arm.clock)
    assert all(abs(one.zero_moved) < 0.004 * one.before.transmission for one in again.differences)
    assert not any((again.changes or {}).values()), "what fits is not written again"


@pytest.mark.slow
def test_who_does_not_want_it_has_changed_nothing(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    before = [bytes(servo.memory.read(0, 40)) for servo in arm.line.servos]
    outcome = calibrate(robot, JOINTS, PLAN.joints, lambda: arm.open_bus(JOINTS), Owner(arm, no=(STORE,)), arm.clock)
    assert not outcome.stored and not calibration_path(robot).exists()
    assert [bytes(servo.memory.read(0, 40)) for servo in arm.line.servos] == before


def test_an_arm_under_torque_is_let_go_only_when_its_owner_says_so(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    arm.line.servo(2).memory.put(sts.torque_enable, 1)
    owner = Owner(arm, no=(release_question(["joint2 (servo 2)"]),))
    with pytest.raises(CalibrationError, match=r"^joint2 \(servo 2\) holds torque, .* nothing was changed"):
        calibrate(robot, JOINTS, PLAN.joints, lambda: arm.open_bus(JOINTS), owner, arm.clock)
    assert torque(arm) == [2]


@pytest.mark.slow
def test_a_joint_that_is_not_swept_is_asked_for_by_name_and_flagged(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm, no=(STORE,))
    owner.skipped = {"joint3"}
    calibrate(robot, JOINTS, PLAN.joints, lambda: arm.open_bus(JOINTS), owner, arm.clock)
    assert any("Not yet from stop to stop: joint3." in text for text in owner.heard)
    assert ["not from stop to stop" in one.doubt for one in owner.shown] == [j.name == "joint3" for j in JOINTS]


def test_who_stops_the_motion_that_is_tried_has_a_limp_arm_and_a_stored_calibration(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm)

    def stopped() -> bool:
        return bool(owner.heard) and owner.heard[-1].endswith(" moves")

    with pytest.raises(StoppedError, match="the arm is limp") as left:
        calibrate(
            robot,
            JOINTS,
            PLAN.joints,
            lambda: arm.open_bus(JOINTS),
            owner,
            arm.clock,
            lambda *_: arm.as_mounted(),
            stopped,
        )
    assert torque(arm) == [] and calibration_path(robot).exists()
    assert "the calibration is stored, and was not tried to the end" in left.value.__notes__


@pytest.mark.slow
def test_a_direction_that_nobody_shows_ends_it_without_a_change(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm, lazy=lambda task: task.kind == "direction" and "joint2" in task.joints)
    with pytest.raises(CalibrationError, match="joint2: which way is positive was not shown"):
        calibrate(robot, JOINTS, PLAN.joints, lambda: arm.open_bus(JOINTS), owner, arm.clock)
    assert not calibration_path(robot).exists()


def test_an_adapter_that_is_pulled_during_the_sweep_ends_it_and_nothing_is_stored(robot: Path) -> None:
    arm = UnalignedArm(SEED)

    class Clumsy(Owner):
        def until_done(self, task: Task, look: Callable[[], None]) -> None:
            self.arm.port.unplug()
            look()

    with pytest.raises(PortLost, match="was unplugged"):
        calibrate(robot, JOINTS, PLAN.joints, lambda: arm.open_bus(JOINTS), Clumsy(arm), arm.clock)
    assert not calibration_path(robot).exists() and torque(arm) == []


def test_a_servo_that_is_absent_or_another_one_is_named_before_anything_is_asked(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm)
    arm.line.faults.silence(4)
    with pytest.raises(ServoSilent, match="servo 4"):
        calibrate(robot, JOINTS, PLAN.joints, lambda: arm.open_bus(JOINTS), owner, arm.clock)
    arm.line.faults.restore(4)
    arm.line.servo(5).memory.put(sts.model_number, 521)
    with pytest.raises(ServoRefused, match="servo 5"):
        calibrate(robot, JOINTS, PLAN.joints, lambda: arm.open_bus(JOINTS), owner, arm.clock)
    assert owner.asked == []
