"""The complete calibration, as called by the command line and scripts."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import pytest

from commissioning.calibrate.by_hand import ByHand, CalibrationTask
from commissioning.calibrate.result import travel_warnings
from commissioning.calibrate.run import (
    DIRECTIONS,
    HANDS_OFF,
    MOVED,
    REPEAT,
    STORE,
    SUPPORT,
    TRY,
    CalibrationDifference,
    JointsToCalibrate,
    by_hand,
    calibrate,
    to_repeat,
)
from commissioning.commissioning_errors import CalibrationError
from commissioning.slow_arm import StoppedError
from drivers.driver_errors import PortLost, ServoRefused, ServoSilent
from drivers.servos import sts
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.robot_file.calibration_file import calibration_path
from hal.servos.limp_arm import release_question
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import CONFIG
from tests.commissioning.arm import JOINTS, PLAN, Person, UnalignedArm
from tests.commissioning.held import HeldArm

SEED = 5


@dataclass
class Owner(Person):
    """A person who also answers questions."""

    no: tuple[str, ...] = ()
    asked: list[str] = field(default_factory=list)
    shown: list[CalibrationDifference] = field(default_factory=list)

    def confirm(self, question: str) -> bool:
        self.asked.append(question)
        return question not in self.no

    def say(self, text: str) -> None:
        super().say(text)
        if text == HANDS_OFF:
            assert torque(self.arm) == [joint.servo_id for joint in self.arm.joints], (
                "it is released when it holds its position"
            )
            self.arm.hand.release()
        if text == SUPPORT:
            assert torque(self.arm), "it is taken before it is limp"
            self.arm.hand.hold()

    def show(self, differences: tuple[CalibrationDifference, ...]) -> None:
        self.shown = list(differences)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text((CONFIG / "robot_arm.yaml").read_text())
    return path


def task(robot: Path, joints: Sequence[Joint] = JOINTS) -> JointsToCalibrate:
    return JointsToCalibrate(robot, joints, PLAN.joints)


def torque(arm: UnalignedArm) -> list[int]:
    registers = {joint.servo_id: series_of(joint.model).torque_enable for joint in arm.joints}
    return [servo.servo_id for servo in arm.line.servos if servo.memory.get(registers[servo.servo_id])]


@pytest.mark.slow
def test_a_calibrated_arm_starts_and_a_second_calibration_agrees(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm)
    outcome = calibrate(task(robot), lambda: arm.open_bus(JOINTS), owner, arm.clock)
    by_hand = DIRECTIONS.format(joints=", ".join(joint.name for joint in JOINTS[1:]))
    assert outcome.stored and outcome.tried and owner.asked == [by_hand, STORE, TRY, MOVED]
    assert [difference.doubt for difference in owner.shown] == [""] * len(JOINTS)
    assert torque(arm) == [] and arm.hand.holds(JOINTS[0].name)
    joints = read_files(robot=robot).robot.joints
    again = calibrate(task(robot, joints), lambda: arm.open_bus(joints), Owner(arm), arm.clock)
    assert all(abs(one.zero_moved) < 0.004 * one.before.transmission for one in again.differences)
    assert not any((again.changes or {}).values()), "what fits is not written again"


@pytest.mark.slow
def test_declining_stores_nothing(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    before = [bytes(servo.memory.read(0, 40)) for servo in arm.line.servos]
    outcome = calibrate(task(robot), lambda: arm.open_bus(JOINTS), Owner(arm, no=(STORE,)), arm.clock)
    assert not outcome.stored and not calibration_path(robot).exists()
    assert [bytes(servo.memory.read(0, 40)) for servo in arm.line.servos] == before


def test_torque_is_released_only_after_confirmation(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    arm.line.servo(2).memory.put(sts.torque_enable, 1)
    owner = Owner(arm, no=(release_question(["joint2 (servo 2)"]),))
    with pytest.raises(CalibrationError, match=r"^joint2 \(servo 2\) has torque enabled, .* nothing was changed"):
        calibrate(task(robot), lambda: arm.open_bus(JOINTS), owner, arm.clock)
    assert torque(arm) == [2]


@pytest.mark.slow
def test_an_unswept_joint_is_requested_again_by_name_and_flagged(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm, no=(STORE,))
    owner.skipped = {"joint3"}
    calibrate(task(robot), lambda: arm.open_bus(JOINTS), owner, arm.clock)
    assert any("Not yet moved from stop to stop: joint3." in text for text in owner.heard)
    assert ["did not reach both stops" in one.doubt for one in owner.shown] == [j.name == "joint3" for j in JOINTS]


def test_stopping_the_motion_test_keeps_the_calibration_and_releases_torque(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm)

    def stopped() -> bool:
        return bool(owner.heard) and owner.heard[-1].endswith(" moves")

    with pytest.raises(StoppedError, match="the arm's torque is disabled") as left:
        calibrate(
            task(robot),
            lambda: arm.open_bus(JOINTS),
            owner,
            arm.clock,
            lambda *_: arm.as_mounted(),
            stopped,
        )
    assert torque(arm) == [] and calibration_path(robot).exists()
    assert "the calibration is stored, but its motion test was not completed" in left.value.__notes__


@pytest.mark.slow
def test_an_unknown_direction_ends_the_calibration_without_changes(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm, lazy=lambda task: task.kind == "direction" and "joint2" in task.joints)
    with pytest.raises(CalibrationError, match="joint2 was not moved in its positive direction"):
        calibrate(task(robot), lambda: arm.open_bus(JOINTS), owner, arm.clock)
    assert not calibration_path(robot).exists()


def test_unplugging_the_adapter_during_the_sweep_stores_nothing(robot: Path) -> None:
    arm = UnalignedArm(SEED)

    class Clumsy(Owner):
        def until_done(self, task: CalibrationTask, update: Callable[[], None]) -> None:
            self.arm.port.unplug()
            update()

    with pytest.raises(PortLost, match="was unplugged"):
        calibrate(task(robot), lambda: arm.open_bus(JOINTS), Clumsy(arm), arm.clock)
    assert not calibration_path(robot).exists() and torque(arm) == []


def test_a_missing_or_wrong_servo_is_named_before_any_question(robot: Path) -> None:
    arm = UnalignedArm(SEED)
    owner = Owner(arm)
    arm.line.faults.silence(4)
    with pytest.raises(ServoSilent, match="servo 4"):
        calibrate(task(robot), lambda: arm.open_bus(JOINTS), owner, arm.clock)
    arm.line.faults.restore(4)
    arm.line.servo(5).memory.put(sts.model_number, 521)
    with pytest.raises(ServoRefused, match="servo 5"):
        calibrate(task(robot), lambda: arm.open_bus(JOINTS), owner, arm.clock)
    assert owner.asked == []


@pytest.mark.slow
@pytest.mark.parametrize("former", [True, False])
def test_a_calibration_with_a_wrong_direction_is_set_aside(robot: Path, former: bool) -> None:
    arm, path = UnalignedArm(SEED), calibration_path(robot)
    if former:
        path.write_text("joints: {}\n")
    owner = Owner(arm, no=(MOVED,))
    wrong = arm.as_mounted()
    wrong["joint1"] = replace(wrong["joint1"], sign=-wrong["joint1"].sign)
    again = (
        "is the previous calibration again. Calibrate again"
        if former
        else r"calibration.yaml.wrong and is not used\. Cal"
    )
    with pytest.raises(CalibrationError, match=again):
        calibrate(task(robot), lambda: arm.open_bus(JOINTS), owner, arm.clock, lambda *_: wrong)
    (said,) = [text for text in owner.heard if text.startswith("joint1 (to the left): it first moves ")]
    assert said.endswith("this direction, then back")
    assert path.with_name(path.name + ".wrong").exists() and torque(arm) == []
    assert (path.read_text() == "joints: {}\n") if former else not path.exists()


def test_implausible_joints_are_measured_again_on_request(robot: Path) -> None:
    arm = HeldArm(SEED, "so101")
    hands = Owner(cast(Any, arm), arm.plan.joints, no=(STORE,))
    hands.skipped = {"elbow_flex"}
    made = ByHand(cast(Any, arm), arm.joints, arm.plan.joints, hands).run()
    hands.skipped = set()
    (elbow,) = to_repeat(arm.joints, made, hands)
    again = made | by_hand(hands)(cast(Any, arm), [elbow], arm.plan.joints)
    assert hands.asked == [REPEAT.format(joints="elbow_flex")]
    assert any(re.match("elbow_flex: it was moved through .* of 3.380", text) for text in hands.heard)
    assert travel_warnings(arm.joints[2], again["elbow_flex"]) == "" and again["gripper"] is made["gripper"]
    assert to_repeat(arm.joints, again, hands) == [] and len(hands.asked) == 1
