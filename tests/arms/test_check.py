"""``arms check`` finds every mistake in a folder, even several at once, and finds none in the included arms."""

import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from servoloop.cli import app
from servoloop.stack.arm_folders import ArmFolder, arms, read_arm
from servoloop.stack.robot_check import check_arm, missing_parts
from servoloop.stack.shipped_files import ARMS

FILES = {
    "arm.yaml": ARMS / "so101" / "arm.yaml",
    "arm.urdf": ARMS / "so101" / "arm.urdf",
    "robot.yaml": ARMS / "so101" / "robot.yaml",
    "scene.xml": ARMS / "so101" / "scene.xml",
    "controllers.yaml": ARMS / "so101" / "controllers.yaml",
    "pick_place.yaml": ARMS / "so101" / "pick_place.yaml",
}
PARALLEL = {
    "arm.yaml": ARMS / "robot_arm" / "arm.yaml",
    "arm.urdf": ARMS.parents[1] / "urdf" / "robot_arm.urdf",
    "robot.yaml": ARMS.parent / "robot_arm.yaml",
    "scene.xml": ARMS.parents[1] / "urdf" / "scene.xml",
    "controllers.yaml": ARMS.parent / "arm_controllers.yaml",
    "pick_place.yaml": ARMS.parent / "vision_pick_place_controller.yaml",
}
"""Arm whose left finger mimics the right finger."""
Edit = tuple[str, str, str]


def folder_with(folder: Path, files: dict[str, Path], *edits: Edit) -> Path:
    """Return a copy of an arm with changes to its files."""
    for name, original in files.items():
        shutil.copy(original, folder / name)
    own = (folder / "arm.yaml").read_text()
    (folder / "arm.yaml").write_text(re.sub(r"^(urdf|robot|scene|controllers|pick_place): .*\n", "", own, flags=re.M))
    for name, old, new in edits:
        text = (folder / name).read_text()
        assert old in text, old
        (folder / name).write_text(text.replace(old, new, 1))
    return folder


@pytest.mark.parametrize("arm", arms(), ids=lambda arm: arm.name)
def test_included_arm_passes_the_check(arm: ArmFolder) -> None:
    assert check_arm(arm.folder) == []


@pytest.mark.parametrize("files", [FILES, PARALLEL], ids=["so101", "parallel"])
def test_copy_in_another_folder_passes_the_check(tmp_path: Path, files: dict[str, Path]) -> None:
    assert check_arm(folder_with(tmp_path, files)) == []


FAULTS: dict[str, tuple[Edit, str]] = {
    "a plugin that is not installed": (
        ("arm.urdf", "servoloop/ServoHardware", "foo/Bar"),
        "unknown <plugin> foo/Bar: choose one of servoloop/ServoHardware,",
    ),
    "a joint without a servo": (
        ("robot.yaml", "  gripper:\n", "  jaw:\n"),
        "robot.yaml: the URDF commands gripper, but the robot file has no servo",
    ),
    "limits beyond the servo's counts": (
        (
            "robot.yaml",
            "servo_id: 1, model: sts3215_c001, sign: 1, zero_counts: 2047",
            "servo_id: 1, model: sts3215_c001, sign: 1, zero_counts: 900",
        ),
        "shoulder_pan: the limits correspond to counts",
    ),
    "a servo of an unknown model": (("robot.yaml", "model: sts3215_c001", "model: sts9"), "unknown model sts9"),
    "a protection that can never act": (
        ("robot.yaml", ", overload_torque: 25", ""),
        "robot.yaml: gripper: overload_torque 80 % is not below the torque limit of 50 %, so",
    ),
    "a mass of zero": (
        ("arm.urdf", '<mass value="0.104"/>', '<mass value="0"/>'),
        "lower_arm_link: its mass in the URDF",
    ),
    "an inertia of zero": (("arm.urdf", 'ixx="2.87438e-05"', 'ixx="0"'), "lower_arm_link: its inertia in the URDF"),
    "a placeholder for the velocity": (
        ("arm.urdf", 'effort="1.91" velocity="4"', 'effort="1.91" velocity="10"'),
        "shoulder_pan: the velocity limit in the URDF is 10, but its servo, sts3215_c001, reaches only 5.45",
    ),
    "a placeholder for the effort": (
        ("arm.urdf", 'effort="1.91" velocity="4"', 'effort="10" velocity="4"'),
        "shoulder_pan: the effort limit in the URDF is 10, but its servo, sts3215_c001, stalls at 1.91",
    ),
    "no effort": (("arm.urdf", ' effort="1.91"', ""), "shoulder_pan: its <limit> in the URDF has no effort"),
    "no ros2_control": (("arm.urdf", "<ros2_control", "<nothing"), "arm.urdf"),
    "a scene that MuJoCo cannot read": (
        ("scene.xml", "<worldbody>", "<world>"),
        "scene.xml: MuJoCo cannot read the scene",
    ),
    "a joint of another name in the scene": (
        ("scene.xml", '<joint name="elbow_flex"', '<joint name="elbow"'),
        "scene.xml: MuJoCo cannot read the scene",
    ),
    "a link elsewhere in the scene": (
        ("scene.xml", 'name="lower_arm_link" pos="-0.11257', 'name="lower_arm_link" pos="-0.1225'),
        "lower_arm_link is up to 0.0099 m and 0.000 rad away from its place in the URDF",
    ),
    "a joint of the other direction in the scene": (
        ("scene.xml", '<joint name="elbow_flex"', '<joint axis="0 0 -1" name="elbow_flex"'),
        "scene.xml: lower_arm_link is up to 0.0000 m and",
    ),
    "a range that differs": (
        ("scene.xml", 'name="wrist_flex" range="-1.65806', 'name="wrist_flex" range="-1.5'),
        "wrist_flex has the range -1.5 to 1.65806 in the scene and -1.65806 to 1.65806 in the URDF",
    ),
    "a mass that differs": (
        ("scene.xml", 'mass="0.104"', 'mass="0.2"'),
        "lower_arm_link weighs 0.2 kg in the scene and 0.104 kg in the URDF",
    ),
    "a center of mass that differs": (
        ("scene.xml", 'pos="-0.0980701 ', 'pos="0.0980701 '),
        "lower_arm_link has its center of mass at",
    ),
    "an inertia that differs": (
        ("scene.xml", 'fullinertia="2.87438e-05', 'fullinertia="4e-05'),
        "lower_arm_link has the principal inertias",
    ),
    "no keyframe": (
        ("scene.xml", 'key name="ready"', 'key name="start"'),
        "scene.xml: the scene has no keyframe ready",
    ),
    "no bin": (("scene.xml", 'body name="bin_B"', 'body name="box"'), "scene.xml: the scene has no body bin_B"),
    "no actuator": (
        ("scene.xml", '<motor name="wrist_roll" joint="wrist_roll"/>', ""),
        "scene.xml: the scene has no actuator wrist_roll",
    ),
    "a ready pose that is not the keyframe's": (
        ("pick_place.yaml", "ready: [0.0, -0.603", "ready: [0.0, -0.5"),
        "poses.ready has shoulder_lift at -0.5, but keyframe ready of scene.xml has it at -0.603",
    ),
    "a pose outside the limits": (
        ("pick_place.yaml", "A: [-1.301", "A: [-2.301"),
        "bins.A: -2.301 is outside the limits -1.91986 to 1.91986 of shoulder_pan",
    ),
    "a hand outside its limits": (
        ("pick_place.yaml", "hand_closed_m: -0.1", "hand_closed_m: -0.3"),
        "hand_closed_m: -0.3",
    ),
    "a pose of another length": (
        ("pick_place.yaml", "A: [-1.301, ", "A: ["),
        "bins.A must have 5 numbers, one per joint",
    ),
    "a grade without a bin": (("pick_place.yaml", "[A, B, C]", "[A, B, C, D]"), "grade D has no pose under bins"),
    "joints that the controller does not have": (
        ("pick_place.yaml", "joints: [shoulder_pan, shoulder_lift", "joints: [shoulder_lift, shoulder_pan"),
        "joints must list the joints of arm_controller",
    ),
    "a load that the servos cannot hold": (
        ("arm.urdf", '<mass value="0.087"/>', '<mass value="1.087"/>'),
        "poses.ready: gravity loads",
    ),
    "a controller of another joint": (("controllers.yaml", "joints: [gripper]", "joints: [jaw]"), "names jaw"),
    "a joint without a calibration": (
        ("arm.yaml", '    wrist_flex: {positive: "Lower the jaws"}\n', ""),
        ": calibration has no entry for wrist_flex",
    ),
    "a calibration without a joint": (
        ("arm.yaml", "start: {shoulder_lift", "start: {shoulder: 0.0, shoulder_lift"),
        ": calibration lists shoulder, which has no servo",
    ),
    "a mistake in arm.yaml": (("arm.yaml", "description:", "descriptive:"), "arm.yaml:1: descriptive"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_mistake_is_found(tmp_path: Path, fault: str) -> None:
    edit, says = FAULTS[fault]
    problems = check_arm(folder_with(tmp_path, FILES, edit))
    assert any(says in problem for problem in problems), problems
    assert all(str(tmp_path) in problem for problem in problems)  # each message names the file


GRIPPER: tuple[Edit, ...] = (
    (
        "controllers.yaml",
        "forward_command_controller/ForwardCommandController",
        "position_controllers/GripperActionController",
    ),
    ("controllers.yaml", "joints: [gripper]\n    interface_name: position", "joint: gripper"),
)
"""Changes after which a gripper action controller drives the hand."""


def test_a_hand_with_a_gripper_action_controller_is_checked(tmp_path: Path) -> None:
    edit = ("pick_place.yaml", "hand_closed_m: -0.1", "hand_closed_m: -0.3")
    (problem,) = check_arm(folder_with(tmp_path, FILES, *GRIPPER, edit))
    assert problem.endswith("hand_closed_m: -0.3 is outside the limits -0.174533 to 1.74533 of gripper")


MIMIC: dict[str, tuple[Edit, str]] = {
    "the wrong sign in the URDF": (
        ("arm.urdf", '<mimic joint="hand_right_joint"/>', '<mimic joint="hand_right_joint" multiplier="-1"/>'),
        "hand_left_joint mimics hand_right_joint and would move from -0.05 to 0, but its limits are 0 to 0.05",
    ),
    "the wrong sign in the scene": (
        ("scene.xml", 'joint2="hand_right_joint" solref', 'joint2="hand_right_joint" polycoef="0 -1 0 0 0" solref'),
        "hand_left_joint follows hand_right_joint with multiplier -1 and offset 0 in the scene, but with 1 and 0 in "
        "the URDF",
    ),
    "no coupling in the scene": (
        ("scene.xml", '<joint joint1="hand_left_joint" joint2="hand_right_joint" solref="0.004 1"/>', ""),
        "hand_left_joint does not follow hand_right_joint in the scene",
    ),
}


@pytest.mark.parametrize("fault", MIMIC)
def test_each_mistake_of_a_mimic_joint_is_found(tmp_path: Path, fault: str) -> None:
    edit, says = MIMIC[fault]
    problems = check_arm(folder_with(tmp_path, PARALLEL, edit))
    assert any(says in problem for problem in problems), problems


def test_mistakes_of_all_files_are_reported_together(tmp_path: Path) -> None:
    names = [
        *("a joint without a servo", "a mass of zero", "a range that differs", "no keyframe"),
        *("a pose outside the limits", "a controller of another joint", "a joint of the other direction in the scene"),
    ]
    problems = check_arm(folder_with(tmp_path, FILES, *(FAULTS[name][0] for name in names)))
    for name in names:
        assert any(FAULTS[name][1] in problem for problem in problems), (name, problems)


@pytest.mark.parametrize("name", ["arm.urdf", "robot.yaml", "scene.xml", "controllers.yaml"])
def test_a_missing_file_is_named(tmp_path: Path, name: str) -> None:
    folder = folder_with(tmp_path, FILES)
    (folder / name).unlink()
    assert any(name in problem for problem in check_arm(folder))


@pytest.mark.parametrize("mass", ["-1", "heavy", "nan"])
def test_invalid_masses_do_not_crash_the_check(tmp_path: Path, mass: str) -> None:
    edit = ("arm.urdf", '<mass value="0.104"/>', f'<mass value="{mass}"/>')
    assert any("lower_arm_link" in problem for problem in check_arm(folder_with(tmp_path, FILES, edit)))


def test_pick_place_parameters_and_scene_are_optional(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILES)
    (folder / "pick_place.yaml").unlink()
    assert check_arm(folder) == []
    (folder / "scene.xml").unlink()
    assert check_arm(folder) == []
    assert [text.partition(":")[0] for text in missing_parts(read_arm(folder))] == [
        "no scene.xml",
        "no pick_place.yaml",
    ]


@pytest.mark.parametrize(("key", "name"), [("scene", "scene.xml"), ("pick_place", "pick_place.yaml")])
def test_files_named_in_arm_yaml_must_exist(tmp_path: Path, key: str, name: str) -> None:
    folder = folder_with(tmp_path, FILES)
    (folder / "pick_place.yaml").unlink()
    (folder / "scene.xml").unlink()
    with (folder / "arm.yaml").open("a") as file:
        file.write(f"{key}: {name}\n")
    assert any(name in problem for problem in check_arm(folder))


BROKEN = {
    "arm.yaml": ("description: SO", "descriptoin: SO", "arm.yaml:1: descriptoin"),
    "arm.urdf": ("<ros2_control", "<nothing", "arm.urdf"),
    "robot.yaml": ("model: sts3215_c001", "model: sts9", "unknown model sts9"),
    "scene.xml": ("<worldbody>", "<world>", "scene.xml: MuJoCo cannot read the scene"),
    "controllers.yaml": ("update_rate: 20", "update_rate: 0", "controllers.yaml:4: controller_manager.update_rate"),
    "pick_place.yaml": ("[A, B, C]", "[A, B, C, D]", "grade D has no pose under bins"),
}
"""One mistake for each file, which makes the file unreadable."""


def test_six_broken_files_are_reported_together(tmp_path: Path) -> None:
    edits = [(name, old, new) for name, (old, new, _) in BROKEN.items()]
    problems = check_arm(folder_with(tmp_path, FILES, *edits))
    assert [text for *_, text in BROKEN.values() if not any(text in problem for problem in problems)] == []


@pytest.mark.parametrize("good", BROKEN)
def test_readable_file_does_not_hide_mistakes_of_others(tmp_path: Path, good: str) -> None:
    edits = [(name, old, new) for name, (old, new, _) in BROKEN.items() if name != good]
    problems = check_arm(folder_with(tmp_path, FILES, *edits))
    expected = [text for name, (*_, text) in BROKEN.items() if name != good]
    assert [text for text in expected if not any(text in problem for problem in problems)] == []


def test_meshes_that_cannot_be_drawn_are_found(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILES)
    (folder / "meshes").mkdir()
    places = folder / "meshes" / "links.yaml"
    places.write_text(
        "links:\n  base_link: [{mesh: none.stl, rgb: [1, 1, 1]}]\n  tail: [{mesh: part.stl, rgb: [1, 1, 1]}]\n"
    )
    (folder / "meshes" / "part.stl").write_text("solid part")
    problems = check_arm(folder)
    assert f"{places}: the URDF has no link tail: correct the name of the link" in problems
    assert any("none.stl cannot be read" in problem for problem in problems)
    assert any("part.stl is not a binary STL file" in problem for problem in problems)
    assert len(problems) == 3
    places.write_text("links: 3\n")
    assert len(check_arm(folder)) == 1


@pytest.mark.parametrize(("lower", "upper"), [(-5, 3000), (3000, 900), (100, 4096)])
def test_a_calibrated_travel_across_the_seam_is_found(tmp_path: Path, lower: int, upper: int) -> None:
    folder = folder_with(tmp_path, FILES)
    (folder / "robot.calibration.yaml").write_text(
        "joints:\n  shoulder_pan: {servo_id: 1, sign: 1, zero_counts: 2047, "
        f"lower_counts: {lower}, upper_counts: {upper}}}\n"
    )
    (problem,) = check_arm(folder)
    assert problem == (
        f"{folder}/robot.calibration.yaml:2: the travel of shoulder_pan, {lower} to {upper}, is not within the counts "
        "0 to 4095 of its servo: calibrate the joint again"
    )


def test_poses_that_the_arm_cannot_reach_are_found(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILES)
    (folder / "poses.yaml").write_text("poses:\n  home: {gripper: 0.1}\n  far: {elbow: 0.0, gripper: 7.0}\n")
    ran = CliRunner().invoke(app, ["arms", "check", str(folder)])
    assert ran.exit_code == 1
    assert f"{folder}/poses.yaml:3: pose far: the arm has no joint elbow; gripper: 7.0000 is outside" in ran.output
    (folder / "poses.yaml").write_text("poses: [home]\n")
    assert f"{folder}/poses.yaml:1: poses" in CliRunner().invoke(app, ["arms", "check", str(folder)]).output
