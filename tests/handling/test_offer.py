"""What a page offers to do with an arm, from the arm's files and its active controllers."""

from pathlib import Path

import pytest

from hal.types import JointLimits
from servoloop.arms.folder import ARMS
from servoloop.handling.offer import CLOSE, OPEN, Offer, offer
from servoloop.handling.poses import FILE, Poses

DRIVEN = {"arm_controller": ("joint1", "joint2"), "hand_controller": ("hand_right_joint",)}
LIMITS = {
    joint: JointLimits(-1.0, 1.0, 2.0, float("inf"), float("inf")) for joints in DRIVEN.values() for joint in joints
}


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    (tmp_path / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'robot_arm'}\n")
    return tmp_path


def test_the_hand_opens_and_closes_where_pick_and_place_does() -> None:
    found = offer("so101", {"arm_controller": ("shoulder_pan",), "hand_controller": ("gripper",)}, {})
    assert found.joints == ("shoulder_pan", "gripper")
    assert found.hand == {OPEN: {"gripper": 0.7}, CLOSE: {"gripper": -0.1}}


@pytest.mark.parametrize(
    ("name", "driven"),
    [("robot_arm", {"arm_controller": ("joint1",)}), ("no arm of ours", DRIVEN)],
)
def test_no_hand_where_nobody_says_which_it_is(name: str, driven: dict[str, tuple[str, ...]]) -> None:
    assert offer(name, driven, LIMITS).hand == {}


def test_poses_that_the_arm_cannot_reach_are_named_and_not_offered(arm: Path) -> None:
    poses = Poses(arm)
    poses.save("good", {"joint1": 0.5})
    poses.save("far", {"joint1": 1.5})
    poses.save("other", {"wheel": 0.0})
    found = offer(str(arm), DRIVEN, LIMITS)
    assert found.poses == {"good": {"joint1": 0.5}}
    far, other = found.refused
    assert far.startswith("not far: joint1 would go to 1.5") and other == "not other: the arm has no wheel"
    still = offer(str(arm), {"arm_controller": ("joint2",)}, LIMITS)
    assert still.poses == {} and still.refused[0] == "not good: no active controller moves joint1"


def test_a_broken_file_of_poses_leaves_joints_and_hand(arm: Path) -> None:
    (arm / FILE).write_text("poses: [")
    found = offer(str(arm), DRIVEN, LIMITS)
    assert found.joints == ("joint1", "joint2", "hand_right_joint") and found.hand[OPEN] == {"hand_right_joint": 0.0}
    assert found.refused[0].startswith("no poses: ") and FILE in found.refused[0]


def test_a_stack_of_no_known_arm_has_its_joints() -> None:
    found = offer("somebody's", DRIVEN, LIMITS)
    assert isinstance(found, Offer) and found.joints and "there is no arm somebody's" in found.refused[0]
