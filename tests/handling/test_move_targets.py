"""Joints and poses that the page can move or go to, from the arm's files and its active controllers."""

from pathlib import Path
from threading import Event, Thread

import pytest
from typer.testing import CliRunner

from hal.types import JointLimits
from servoloop.cli import app
from servoloop.manual.poses import CLOSE, FILE, OPEN, MoveTargets, Poses, find_targets
from servoloop.stack.shipped_files import ARMS
from tests.live.rig import LiveRig, runtime_folder

DRIVEN = {"arm_controller": ("joint1", "joint2"), "hand_controller": ("hand_right_joint",)}
WIDE = JointLimits(-4.0, 4.0, 2.0, float("inf"), float("inf"))
LIMITS = {
    joint: JointLimits(-1.0, 1.0, 2.0, float("inf"), float("inf")) for joints in DRIVEN.values() for joint in joints
}


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    (tmp_path / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'robot_arm'}\n")
    return tmp_path


def test_the_hand_poses_are_those_of_pick_and_place() -> None:
    found = find_targets(ARMS / "so101", {"arm_controller": ("shoulder_pan",), "hand_controller": ("gripper",)}, {})
    assert found.joints == ("shoulder_pan", "gripper")
    assert found.hand == {OPEN: {"gripper": 0.7}, CLOSE: {"gripper": -0.1}}


@pytest.mark.parametrize(
    ("folder", "driven"),
    [(ARMS / "robot_arm", {"arm_controller": ("joint1",)}), (ARMS, DRIVEN), (None, DRIVEN)],
)
def test_without_a_known_hand_joint_there_are_no_hand_poses(
    folder: Path | None, driven: dict[str, tuple[str, ...]]
) -> None:
    assert find_targets(folder, driven, LIMITS).hand == {}


def test_poses_that_the_arm_cannot_reach_are_refused_with_a_reason(arm: Path) -> None:
    poses = Poses(arm)
    poses.save("good", {"joint1": 0.5})
    poses.save("far", {"joint1": 1.5})
    poses.save("other", {"wheel": 0.0})
    found = find_targets(arm, DRIVEN, LIMITS)
    assert found.poses == {"good": {"joint1": 0.5}}
    far, other = found.refused
    assert (
        far.startswith("far is not available: joint1: 1.5")
        and other == "other is not available: the arm has no joint wheel"
    )
    still = find_targets(arm, {"arm_controller": ("joint2",)}, LIMITS)
    assert still.poses == {} and still.refused[0] == "good is not available: no active controller moves joint1"


def test_an_invalid_pose_file_does_not_affect_joints_and_hand(arm: Path) -> None:
    (arm / FILE).write_text("poses: [")
    found = find_targets(arm, DRIVEN, LIMITS)
    assert found.joints == ("joint1", "joint2", "hand_right_joint") and found.hand[OPEN] == {"hand_right_joint": 0.0}
    assert found.refused[0].startswith("No poses are available: ") and FILE in found.refused[0]


def test_without_the_arm_folder_there_are_joints_but_no_poses() -> None:
    found = find_targets(None, DRIVEN, LIMITS)
    assert isinstance(found, MoveTargets) and found.joints and "does not report its arm's folder" in found.refused[0]


def test_poses_are_saved_in_the_folder_of_the_running_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "so101"
    own.mkdir()
    (own / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'so101'}\n")
    monkeypatch.chdir(tmp_path)
    shipped = ARMS / "so101" / FILE
    with runtime_folder(monkeypatch):
        rig = LiveRig("so101", folder=own)
        ended = Event()
        playing = Thread(target=lambda: [rig.play(0.1) for _ in iter(ended.is_set, True)])
        playing.start()
        try:
            done = CliRunner().invoke(app, ["pose", "save", "mine"], catch_exceptions=False)
        finally:
            ended.set()
            playing.join()
            rig.feed.close((), failed=False)
    assert done.exit_code == 0 and str(own / FILE) in done.output and not shipped.exists()
    (pose,) = Poses(own).all().values()
    assert set(pose) == set(rig.stack.loop.hardware.joints)
    assert "mine: " in CliRunner().invoke(app, ["pose", "list", "--arm", "./so101"]).output
    assert find_targets(own, {"all": tuple(pose)}, dict.fromkeys(pose, WIDE)).poses == {"mine": pose}
