"""Every arm can be planned between its named states, with its hand in each named state."""

from itertools import permutations
from pathlib import Path

import pytest

from planning.motion import JointGoal, MotionRequest
from planning.robot import PlanningRobot
from servoloop.api.options import ArmOptions
from servoloop.motion_planning.robot import planning_robot
from servoloop.stack.arm_folders import find_arm
from tests.arms.test_check import FILES, folder_with
from tests.arms.test_new import made


def robot(arm: str) -> PlanningRobot:
    return planning_robot(ArmOptions(arm).files())


@pytest.mark.parametrize("arm", ["robot_arm", "so100", "so101", "koch"])
def test_the_arm_moves_between_its_states_with_every_state_of_the_hand(arm: str) -> None:
    arms = robot(arm)
    moved, hand = arms.group("arm"), arms.groups.group("hand")
    for held in hand.states.values():
        for one, other in permutations(moved.group.states.values(), 2):
            start = {**arms.rest, **held, **one}
            goals = (JointGoal(other),)
            scene = arms.scene.without("cube")
            end = moved.plan(MotionRequest(start=start, goals=goals, scene=scene, remaining_s=lambda: 5.0)).end
            assert {joint: end[joint] for joint in other} == pytest.approx(other, abs=1e-6)
            turned = arms.group("hand")
            for jaw in hand.states.values():
                request = MotionRequest(start=start, goals=(JointGoal(jaw),), scene=scene, remaining_s=lambda: 5.0)
                assert turned.plan(request).end[hand.joints[0]] == pytest.approx(jaw[hand.joints[0]], abs=1e-6)


def test_a_park_pose_of_some_joints_is_not_a_state(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILES, ("robot.yaml", "shoulder_pan: 0.287, ", ""))
    assert "park" in robot("so101").groups.group("arm").states
    assert "park" not in robot(str(folder)).groups.group("arm").states


@pytest.mark.parametrize(
    ("saved", "logged"),
    [
        (
            "poses:\n  home: {shoulder_pan: 0.1}\n  far: {shoulder_pan: 2.5, elbow_flex: 0.0}\n",
            "poses.yaml: pose far is not available for planning, because shoulder_pan is at 2.5, outside its limits "
            "-1.91986 to 1.91986: correct the position",
        ),
        ("poses: {home: [1, 2]}\n", "the saved poses are not available for planning: "),
    ],
)
def test_a_pose_that_cannot_be_used_does_not_prevent_planning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, saved: str, logged: str
) -> None:
    folder = folder_with(tmp_path, FILES)
    (folder / "poses.yaml").write_text(saved)
    states = robot(str(folder)).groups.group("arm").states
    assert set(states) == {"park", "ready"}
    assert logged in caplog.text and "poses.yaml" in caplog.text


def test_the_root_link_of_an_arm_may_have_any_name(tmp_path: Path) -> None:
    planned = robot(str(made(tmp_path, find_arm("so101").urdf.read_text().replace('"base_link"', '"foot"'))))
    assert planned.frame == "foot"
    goals = (JointGoal({"shoulder_pan": 0.3}),)
    request = MotionRequest(start=planned.rest, goals=goals, scene=planned.scene, remaining_s=lambda: 5.0)
    assert planned.group("arm").plan(request).end["shoulder_pan"] == pytest.approx(0.3, abs=1e-6)


def test_only_pairs_of_links_that_are_near_by_design_are_not_checked() -> None:
    koch = robot("koch").scene.allowed
    assert ("moving_side_link", "wrist_link") in koch
    assert ("base_link", "gripper_link") not in koch
