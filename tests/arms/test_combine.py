"""``arms combine`` writes a robot with several arms. The included robot with two arms equals the output of this
command."""

import os
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from hal.hal_errors import ArmFileError
from servoloop import cli
from servoloop.arms.combine import combine, combined, parse_arms, parse_bases
from servoloop.manual.poses import CLOSE, OPEN, Poses, find_targets
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.pick_place import load_pick_places
from servoloop.stack.robot_check import check_arm
from servoloop.stack.shipped_files import ARMS
from sim_backend.scene.scene_file import scene_model

PAIR = {"left": "so101", "right": "so101"}


def arms_at(folder: Path, arms: dict[str, str], *bases: str) -> Path:
    combine(folder, arms, parse_bases(bases, list(arms)))
    return folder


def test_the_included_robot_is_the_output_of_the_command() -> None:
    folder = ARMS / "bimanual_so101"
    made = combined(folder, PAIR, parse_bases([], list(PAIR)))
    scene = mujoco.MjModel.from_xml_string(made.pop("scene.xml"))  # Its text depends on the version of MuJoCo.
    assert {path: (folder / path).read_text() for path in made} == made
    shipped = scene_model(folder / "scene.xml")
    assert [shipped.body(i).name for i in range(shipped.nbody)] == [scene.body(i).name for i in range(scene.nbody)]
    for values in ("body_pos", "body_quat", "geom_size", "geom_contype", "geom_conaffinity", "jnt_range", "key_qpos"):
        np.testing.assert_allclose(getattr(shipped, values), getattr(scene, values), atol=1e-6, err_msg=values)


def test_different_arms_stand_where_the_bases_put_them(tmp_path: Path) -> None:
    folder = arms_at(tmp_path / "mixed", {"a": "koch", "b_2": "so101"}, "a=0.1,0.5,0,0", "b_2=0,-0.5,0.02,1.5")
    assert check_arm(folder) == []
    files = read_arm_files(find_arm(str(folder)))
    assert list(files.robot.file.lines()) == ["a", "b_2"]
    assert {joint.name: joint.bus for joint in files.robot.joints}["b_2_gripper"] == "b_2"
    model = scene_model(folder / "scene.xml")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mounts = {name: files.description.joints[f"{name}_mount"] for name in ("a", "b_2")}
    for name, mount in mounts.items():
        np.testing.assert_allclose(data.body(f"{name}_base_link").xpos, mount.xyz_m, atol=1e-6)
    assert mounts["b_2"].xyz_m == (0.0, -0.5, 0.0224), "the foot of an SO-101 is 2.4 mm below its base"
    yaw = np.arctan2(*data.body("b_2_base_link").xmat[[3, 0]])
    assert yaw == pytest.approx(1.5) and data.body("b_2_stand").xpos[0] == pytest.approx(0.225 * np.cos(1.5), abs=1e-5)


def test_links_of_two_arms_collide_and_links_of_one_arm_do_not() -> None:
    model = scene_model(find_arm("bimanual_so101").scene)

    def collide(one: str, other: str) -> bool:
        pairs = [(model.body(name).geomadr[0], model.body(name).geomadr[0]) for name in (one, other)]
        (first, _), (second, _) = pairs
        types, affinities = model.geom_contype, model.geom_conaffinity
        return bool(types[first] & affinities[second] or types[second] & affinities[first])

    assert collide("left_gripper_link", "right_wrist_link") and collide("right_wrist_link", "left_gripper_link")
    assert collide("right_gripper_link", "left_bin_A") and collide("left_gripper_link", "left_cube")
    assert not collide("left_gripper_link", "left_base_link") and not collide("right_gripper_link", "right_base_link")


def test_the_poses_and_the_calibration_of_a_users_arm_are_kept(tmp_path: Path) -> None:
    shutil.copytree(ARMS / "so101", mine := tmp_path / "mine")
    Poses(mine).save("home", {"shoulder_pan": 0.5})
    joint = "{servo_id: 1, sign: -1, zero_counts: 2000, lower_counts: 800, upper_counts: 3200}"
    (mine / "robot.calibration.yaml").write_text(f"joints:\n  shoulder_pan: {joint}\n")
    folder = arms_at(tmp_path / "two", {"left": str(mine), "right": str(mine)})
    servos = {
        joint.name: (joint.sign, joint.zero_counts) for joint in read_arm_files(find_arm(str(folder))).robot.joints
    }
    assert servos["right_shoulder_pan"] == (-1, 2000) and servos["right_gripper"] == (1, 2047)
    both = {"left_shoulder_pan": 0.5, "right_shoulder_pan": 0.5}
    assert Poses(folder).get("home") == both and Poses(folder).get("left_home") == {"left_shoulder_pan": 0.5}


def test_a_running_robot_opens_and_closes_both_hands() -> None:
    folder = ARMS / "bimanual_so101"
    driven = {f"{name}_hand_controller": (f"{name}_gripper",) for name in PAIR}
    targets = find_targets(folder, driven, read_arm_files(find_arm("bimanual_so101")).limits)
    assert targets.hand[OPEN] == {"left_gripper": 0.7, "right_gripper": 0.7}
    assert targets.hand[CLOSE] == {"left_gripper": -0.1, "right_gripper": -0.1}
    assert find_targets(folder, {"left_hand_controller": ("left_gripper",)}, {}).hand[OPEN] == {"left_gripper": 0.7}


def test_each_arm_has_a_node_with_its_controllers() -> None:
    jobs = load_pick_places(find_arm("bimanual_so101").pick_place)
    assert list(jobs) == ["left_vision_pick_place_controller", "right_vision_pick_place_controller"]
    assert [job.settings().hand_controller for job in jobs.values()] == [
        "left_hand_controller",
        "right_hand_controller",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["left=so101", "left=koch"], "the prefix left is given twice: choose a different prefix for each arm"),
        (["Left=so101", "right=so101"], "'Left=so101' is not PREFIX=ARM, such as left=so101"),
        (["left=so101"], "specify at least two arms"),
        (["left=so101", "right=so102"], "there is no arm so102: choose one of"),
        (["left=so101", "right=bimanual_so101"], "bimanual_so101 already has several arms"),
        (["left=so101", "right=so101", "--base", "up=0,0,0,0"], "there is no arm up; choose one of left, right"),
        (["left=so101", "right=so101", "--base", "left=0,0,0"], "write PREFIX=X,Y,Z,YAW in m and rad"),
        (["left=so101", "right=so101", "--base", "left=0,0,nan,0"], "write PREFIX=X,Y,Z,YAW in m and rad"),
        (
            ["left=so101", "right=so101", "--base", "left=0,0.03,0,0", "--base", "right=0,-0.03,0,0"],
            "the arms overlap in the pose zero (left_base_link and right_base_link",
        ),
    ],
)
def test_mistakes_name_the_remedy(tmp_path: Path, arguments: list[str], message: str) -> None:
    out = tmp_path / "out"
    outcome = CliRunner().invoke(cli.app, ["arms", "combine", *arguments, "--out", str(out)])
    assert isinstance(outcome.exception, ArmFileError) and message in str(outcome.exception)
    assert len(str(outcome.exception).splitlines()) == 1 and not out.exists()


def test_no_folder_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text("mine")
    with pytest.raises(ArmFileError, match="already exists: choose another folder"):
        combine(tmp_path, PAIR, parse_bases([], list(PAIR)))
    assert parse_arms(["left=so101", "right=so101"]) == PAIR


def test_a_folder_whose_name_is_not_utf8_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ArmFileError, match="cannot be the name of an arm: use printable characters"):
        combine(tmp_path / os.fsdecode(b"two\xfc"), PAIR, parse_bases([], list(PAIR)))
