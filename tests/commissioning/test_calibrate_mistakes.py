"""Every mistake of the user during calibration is reported before anything is stored."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from commissioning.calibrate.by_hand import ByHand, CalibrationTask
from commissioning.calibrate.result import JointCalibration, travel_warnings, uncertainty
from commissioning.calibrate.run import DIRECTIONS, by_hand, to_turn_round
from commissioning.calibrate.sweep import Swept
from commissioning.commissioning_errors import CalibrationError
from hal.joint import Joint
from tests.commissioning.arm import Person, off_rad
from tests.commissioning.held import HeldArm

SEED = 3


@dataclass
class Clumsy(Person):
    """A person who makes mistakes with some joints."""

    share: Mapping[str, float] = field(default_factory=dict)
    """Share of the travel through which a joint is swept, from its lower stop."""
    wrong_ways: dict[str, int] = field(default_factory=dict)
    """Number of times that a joint is first moved in the wrong direction."""
    wrong_poses: dict[str, list[float]] = field(default_factory=dict)
    """Distances from the marked pose, one for each time that the user shows the pose."""
    instead: Mapping[str, str] = field(default_factory=dict)
    """Joint that the user moves instead of the requested one."""
    tasks: list[CalibrationTask] = field(default_factory=list)

    def until_done(self, task: CalibrationTask, update: object) -> None:
        self.tasks.append(task)
        super().until_done(task, update)  # type: ignore[arg-type]

    def move(self, kind: str, joints: Sequence[str], update: object) -> None:
        super().move(kind, [self.instead.get(name, name) for name in joints], update)  # type: ignore[arg-type]

    def _ways(self, kind: str, joint: Joint) -> list[float]:
        ways = super()._ways(kind, joint)
        if kind == "sweep" and joint.name in self.share:
            lower, upper = joint.limits.lower, joint.limits.upper
            return [ways[0], lower + self.share[joint.name] * (upper - lower), ways[2]]
        if kind == "direction" and self.wrong_ways.get(joint.name, 0) > 0:
            self.wrong_ways[joint.name] -= 1
            return [ways[1], ways[1] - 0.6 * joint.transmission]
        if kind == "pose" and self.wrong_poses.get(joint.name):
            return [ways[0] + self.wrong_poses[joint.name].pop(0)]
        return ways

    def asked(self, kind: str, joint: str) -> list[str]:
        return [task.text for task in self.tasks if task.kind == kind and joint in task.joints]


def calibrated(arm: HeldArm, hands: Clumsy, *names: str) -> tuple[dict[str, Joint], Mapping[str, JointCalibration]]:
    """Calibrate these joints and return them with their calibrations."""
    joints = [joint for joint in arm.joints if joint.name in names]
    found = ByHand(cast(Any, arm.bus), joints, hands.plans, hands).run()
    return {joint.name: joint for joint in joints}, found


def clumsy(name: str, **mistakes: object) -> tuple[HeldArm, Clumsy]:
    arm = HeldArm(SEED, name)
    return arm, Clumsy(cast(Any, arm), arm.plan.joints, **cast(Any, mistakes))


@pytest.mark.parametrize("share", [0.975, 0.85])
def test_a_short_sweep_is_requested_again_with_the_measured_share(share: float) -> None:
    arm, hands = clumsy("so101", share={"elbow_flex": share})
    joints, found = calibrated(arm, hands, "elbow_flex")
    sweeps = hands.asked("sweep", "elbow_flex")
    assert len(sweeps) == 2, "the same ends twice are stops"
    assert sweeps[1].startswith("Not yet moved from stop to stop: elbow_flex. Move it to both stops (elbow_flex: ")
    assert "of 3.380 in the URDF" in sweeps[1]
    joint, made = joints["elbow_flex"], found["elbow_flex"]
    assert "Was a stop missed" in travel_warnings(joint, made)
    assert uncertainty(joint, made, "middle") > off_rad(arm, joint, made) > 0.02


def test_a_short_travel_is_accepted_after_a_second_sweep() -> None:
    class Learning(Clumsy):
        def until_done(self, task: CalibrationTask, update: object) -> None:
            super().until_done(task, update)
            self.share = {}

    arm, hands = clumsy("so101")
    learning = Learning(cast(Any, arm), hands.plans, share={"elbow_flex": 0.9})
    joints, found = calibrated(arm, learning, "elbow_flex")
    assert len(learning.asked("sweep", "elbow_flex")) == 2
    assert travel_warnings(joints["elbow_flex"], found["elbow_flex"]) == ""
    assert off_rad(arm, joints["elbow_flex"], found["elbow_flex"]) < 0.01


def test_unconfirmed_directions_are_asked_about_and_measured_again() -> None:
    arm, hands = clumsy("so100", wrong_ways={"shoulder_pan": 1})
    joints, found = calibrated(arm, hands, "shoulder_pan", "elbow_flex", "wrist_roll")
    assert found["shoulder_pan"].sign != arm.coupling("shoulder_pan").sign

    @dataclass
    class Doubting(Clumsy):
        questions: list[str] = field(default_factory=list)

        def confirm(self, question: str) -> bool:
            self.questions.append(question)
            return False

    owner = Doubting(cast(Any, arm), hands.plans)
    before = tuple(replace(j, homing_offset=0, sign=arm.coupling(j.name).sign) for j in joints.values())
    again = to_turn_round(before, owner.plans, found, cast(Any, owner))
    assert owner.questions == [DIRECTIONS.format(joints="shoulder_pan, wrist_roll")], "the elbow's stops show its own"
    assert "shoulder_pan: its direction is opposite to that of the previous calibration" in owner.heard
    assert not any(text.startswith("wrist_roll: its direction") for text in owner.heard)
    assert [joint.name for joint in again] == ["shoulder_pan", "wrist_roll"]
    measured = by_hand(cast(Any, owner))(cast(Any, arm.bus), again, owner.plans)
    assert measured["shoulder_pan"].sign == arm.coupling("shoulder_pan").sign


@pytest.mark.parametrize(("times", "asked"), [(1, 2), (9, 3)])
def test_a_direction_that_contradicts_the_stops_is_requested_again(times: int, asked: int) -> None:
    arm, hands = clumsy("so100", wrong_ways={"elbow_flex": times})
    joints, found = calibrated(arm, hands, "elbow_flex")
    joint, made = joints["elbow_flex"], found["elbow_flex"]
    (first, *_) = [text for text in hands.heard if "its stops are at" in text]
    assert "was it moved in the wrong direction" in first
    assert len(hands.asked("direction", "elbow_flex")) >= asked
    right = made.sign == arm.coupling("elbow_flex").sign
    assert right == (times == 1) == (travel_warnings(joint, made) == "")


@pytest.mark.parametrize("off", [0.1745, -0.45])
def test_a_pose_that_contradicts_the_stops_is_requested_again(off: float) -> None:
    arm, hands = clumsy("so101", wrong_poses={"wrist_roll": [off]})
    joints, found = calibrated(arm, hands, "wrist_roll")
    assert len(hands.asked("pose", "wrist_roll")) == 2
    off_by = f"is its zero off by {abs(off):.2f}"[:-1]
    assert any("wrist_roll: its stops are at" in text and off_by in text for text in hands.heard)
    assert off_rad(arm, joints["wrist_roll"], found["wrist_roll"]) < 0.02


@pytest.mark.parametrize(("name", "joint_name", "off"), [("so101", "wrist_roll", 0.1745), ("koch", "wrist_flex", 0.2)])
def test_a_wrong_pose_is_flagged_and_increases_the_uncertainty(name: str, joint_name: str, off: float) -> None:
    arm, hands = clumsy(name, wrong_poses={joint_name: [off] * 9})
    joints, found = calibrated(arm, hands, joint_name)
    joint, made = joints[joint_name], found[joint_name]
    assert "its stops are at" in travel_warnings(joint, made)
    assert uncertainty(joint, made, "pose") == pytest.approx(off, abs=0.03)


def test_a_freely_turning_joint_needs_two_poses_and_no_sweep() -> None:
    arm, hands = clumsy("so100", wrong_poses={"wrist_roll": [0.5]})
    joints, found = calibrated(arm, hands, "wrist_roll")
    joint, made = joints["wrist_roll"], found["wrist_roll"]
    assert hands.asked("sweep", "wrist_roll") == [] and len(hands.asked("pose", "wrist_roll")) == 3
    assert any("the two poses are 0.5" in text for text in hands.heard)
    assert off_rad(arm, joint, made) < 0.02
    assert abs(made.zero_counts - 2048) <= 1 and (made.lower_counts, made.upper_counts) == (0, 4095)
    assert uncertainty(joint, made, "pose") == 0.05


def test_exchanged_ids_are_reported() -> None:
    arm, hands = clumsy("so101", instead={"shoulder_pan": "elbow_flex", "elbow_flex": "shoulder_pan"})
    exchanged = r"shoulder_pan: servo 1 did not move, but servo 3 \(elbow_flex\) moved twice"
    with pytest.raises(CalibrationError, match=exchanged):
        calibrated(arm, hands, "shoulder_pan", "elbow_flex")
    again = hands.asked("direction", "shoulder_pan")[1]
    assert again.startswith("shoulder_pan hardly moved, but servo 3 (elbow_flex) turned. ")


@given(
    st.lists(st.integers(-15, 15), min_size=4, max_size=40),
    st.integers(0, 40),
    st.sampled_from((-1500, -300, 300, 1500)),
)
def test_one_wrong_reading_does_not_lengthen_a_sweep(steps: list[int], at: int, false: int) -> None:
    true = [2000 + sum(steps[:n]) for n in range(len(steps) + 1)]
    readings = list(true)
    readings[at % len(true)] += false
    swept = Swept(readings[0], readings[0], readings[0])
    for reading in readings[1:]:
        swept.take(reading % 4096, 4096)
    assert min(true) <= swept.lower <= swept.upper <= max(true)
