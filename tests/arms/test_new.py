"""``servoloop arms new`` turns any URDF into an arm that passes the check and moves with virtual servos."""

import os
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from hal.hal_errors import ArmFileError
from servoloop import cli
from servoloop.simulation.job import require_cell
from servoloop.stack.arm_folders import find_arm, read_arm, read_arm_files
from servoloop.stack.robot_check import check_arm
from servoloop.stack.virtual_lines import VirtualLines
from sim_backend.buses.build import Build
from sim_backend.scene.world import World

RUNNER = CliRunner()
BLOCK = re.compile(r"\s*<ros2_control.*?</ros2_control>", re.DOTALL)
TWO_JOINTS = """<?xml version="1.0"?>
<!-- A comment of the user's about <robot>. -->
<robot name="mine">
  <link name="foot"/>
  <link name="upper">
    <inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="upper.stl"/></geometry></visual>
  </link>
  <link name="lower">
    <inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="lift" type="revolute">
    <parent link="foot"/><child link="upper"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="3" effort="2"/>
  </joint>
  <joint name="bend" type="revolute">
    <parent link="upper"/><child link="lower"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="3" effort="2"/>
  </joint>
</robot>
"""


def new(folder: Path, text: str, name: str = "my_arm", *options: str) -> Result:
    """Run the command in a folder with this URDF."""
    (folder / "robot.urdf").write_text(text)
    return RUNNER.invoke(cli.app, ["arms", "new", str(folder / name), str(folder / "robot.urdf"), *options])


def made(folder: Path, text: str, *options: str) -> Path:
    """Return the folder of the new arm."""
    result = new(folder, text, "my_arm", *options)
    assert result.exit_code == 0, result.output
    return folder / "my_arm"


def refusal(folder: Path, text: str, name: str = "my_arm") -> str:
    """Return the error for a URDF or a name, and check that nothing was written."""
    before = sorted(folder.rglob("*"))
    result = new(folder, text, name)
    assert result.exit_code == 1 and result.exception is not None
    assert sorted(set(folder.rglob("*")) - {folder / "robot.urdf"}) == [one for one in before if one.suffix != ".urdf"]
    return str(result.exception)


@pytest.mark.parametrize("arm", ["so101", "so100", "koch", "robot_arm"])
def test_a_urdf_without_a_ros2_control_block_becomes_an_arm(tmp_path: Path, arm: str) -> None:
    text = BLOCK.sub("", find_arm(arm).urdf.read_text())
    folder = made(tmp_path, text)
    assert sorted(path.name for path in folder.iterdir()) == [
        *("arm.urdf", "arm.yaml", "controllers.yaml", "robot.yaml", "scene.xml"),
    ]
    assert check_arm(folder) == []
    joints = read_arm_files(read_arm(folder)).robot.joints
    assert {joint.name for joint in joints} == {joint.name for joint in read_arm_files(find_arm(arm)).robot.joints}


def test_existing_block_is_replaced_and_selects_the_driven_joints(tmp_path: Path) -> None:
    block = """<ros2_control name="old" type="system"><hardware><plugin>acme/Hardware</plugin></hardware>
      <joint name="bend"><command_interface name="velocity"/></joint></ros2_control></robot>"""
    files = read_arm_files(read_arm(made(tmp_path, TWO_JOINTS.replace("</robot>", block))))
    assert files.component.commands == ("bend/position",)
    assert [one.plugin for one in files.description.components] == ["servoloop/ServoHardware"]


def test_the_virtual_servos_hold_and_move_the_arm(tmp_path: Path) -> None:
    files = read_arm_files(read_arm(made(tmp_path, TWO_JOINTS)))
    virtual = VirtualLines(files, Build(0.0))
    assert virtual.world.joints == ("lift", "bend")
    virtual.advance(0.5)
    assert np.abs(virtual.world.position()).max() < 0.01  # the arm is held until a servo drives it
    assert virtual.world.poses() == {} and virtual.world.cube_bin() is None and not virtual.world.laid


def test_comments_stay_and_meshes_are_found_from_the_new_folder(tmp_path: Path) -> None:
    (tmp_path / "upper.stl").write_bytes(b"")
    text = (made(tmp_path, TWO_JOINTS) / "arm.urdf").read_text()
    assert "A comment of the user's about <robot>." in text and 'filename="../upper.stl"' in text


def test_a_continuous_joint_gets_the_range_of_its_servo(tmp_path: Path) -> None:
    limit = '<limit lower="-1" upper="1" velocity="3" effort="2"/>'
    text = TWO_JOINTS.replace('"lift" type="revolute"', '"lift" type="continuous"').replace(limit, "", 1)
    lift = read_arm_files(read_arm(made(tmp_path, text))).robot.joints[0]
    assert lift.limits.lower == pytest.approx(-3.08, abs=0.01) and lift.limits.upper == pytest.approx(3.08, abs=0.01)


@pytest.mark.parametrize(("lower", "upper"), [(-6.28, 6.28), (0.0, 4.0), (2.0, 5.0), (-5.0, -4.0)])
def test_any_range_is_mapped_to_the_counts_of_the_servo(tmp_path: Path, lower: float, upper: float) -> None:
    folder = made(tmp_path, TWO_JOINTS.replace('lower="-1" upper="1"', f'lower="{lower}" upper="{upper}"', 1))
    assert check_arm(folder) == []
    start = dict(zip(("lift", "bend"), World(folder / "scene.xml").position(), strict=True))
    assert lower <= start["lift"] <= upper and start["bend"] == 0.0


@pytest.mark.parametrize("name", ["1", "yes", "null", "größe", "a: b"])
def test_joint_names_that_look_like_other_yaml_values_are_kept(tmp_path: Path, name: str) -> None:
    folder = made(tmp_path, TWO_JOINTS.replace('"lift"', f'"{name}"'))
    assert read_arm_files(read_arm(folder)).robot.joints[0].name == name


def test_mimic_fingers_have_no_servo_and_the_hand_is_last(tmp_path: Path) -> None:
    text = BLOCK.sub("", find_arm("robot_arm").urdf.read_text()).replace('"joint6"', '"wrist"')
    files = read_arm_files(read_arm(made(tmp_path, text)))
    assert files.robot.joints[-1].name == "hand_right_joint"
    assert [one.name for one in files.controllers.controllers] == [
        *("joint_state_broadcaster", "arm_controller", "hand_controller"),
    ]


def test_an_arm_without_a_hand_has_no_hand_controller(tmp_path: Path) -> None:
    files = read_arm_files(read_arm(made(tmp_path, TWO_JOINTS)))
    assert "hand_controller" not in [one.name for one in files.controllers.controllers]


def test_other_servos_and_their_bus(tmp_path: Path) -> None:
    file = read_arm_files(read_arm(made(tmp_path, TWO_JOINTS, "--servo", "xl430-w250"))).robot.file
    assert file.bus is not None and file.bus.protocol == "dynamixel"
    assert {joint.model for joint in file.joints.values()} == {"xl430-w250"}


def test_remaining_corrections_are_printed(tmp_path: Path) -> None:
    result = new(tmp_path, TWO_JOINTS.replace('velocity="3" effort="2"', 'velocity="10" effort="99"'))
    assert result.exit_code == 0
    assert (
        "lift: the velocity limit in the URDF is 10" in result.output
        and "bend: the effort limit in the URDF is 99" in result.output
    )


@pytest.mark.parametrize(
    ("old", "new_text", "expected"),
    [
        ('velocity="3" ', "", "velocity"),
        ('type="revolute"', 'type="fixed"', "has no joint that a servo could drive"),
        (
            '<link name="foot"/>',
            '<xacro:foot xmlns:xacro="http://www.ros.org/wiki/xacro"/>',
            "this file is xacro, not URDF",
        ),
        ("</robot>", "", "not well-formed XML"),
        ('<child link="lower"/>', '<child link="nowhere"/>', "nowhere"),
    ],
)
def test_unusable_urdf_is_refused_with_a_reason(tmp_path: Path, old: str, new_text: str, expected: str) -> None:
    text = refusal(tmp_path, TWO_JOINTS.replace(old, new_text))
    assert expected in text and "robot.urdf" in text


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("so101", "servoloop already includes an arm so101: choose another name"),
        ("my-arm", "cannot be the name of an arm"),
        ("1arm", "cannot be the name of an arm"),
    ],
)
def test_a_name_that_cannot_be_used_is_refused(tmp_path: Path, name: str, expected: str) -> None:
    assert expected in refusal(tmp_path, TWO_JOINTS, name)


def test_folder_with_files_is_not_changed(tmp_path: Path) -> None:
    (tmp_path / "my_arm").mkdir()
    (tmp_path / "my_arm" / "notes.txt").write_text("mine")
    assert "already exists" in refusal(tmp_path, TWO_JOINTS)


def test_the_file_may_be_in_another_encoding(tmp_path: Path) -> None:
    text = TWO_JOINTS.replace('version="1.0"', 'version="1.0" encoding="ISO-8859-1"').replace("comment", "Größe")
    (tmp_path / "robot.urdf").write_bytes(text.encode("latin-1"))
    result = RUNNER.invoke(cli.app, ["arms", "new", str(tmp_path / "my_arm"), str(tmp_path / "robot.urdf")])
    assert result.exit_code == 0, result.output
    assert "Größe" in (tmp_path / "my_arm" / "arm.urdf").read_text()
    assert ElementTree.parse(tmp_path / "my_arm" / "arm.urdf").getroot().get("name") == "mine"


def test_simulate_moves_an_arm_without_a_cell_and_refuses_its_jobs(tmp_path: Path) -> None:
    folder = made(tmp_path, TWO_JOINTS)
    ran = RUNNER.invoke(cli.app, ["simulate", "--arm", str(folder), "--seconds", "1"])
    assert ran.exit_code == 0, ran.output
    ran = RUNNER.invoke(cli.app, ["simulate", "--arm", str(folder), "--job", "A"])
    assert "pick_place.yaml is missing" in str(ran.exception)


def test_jobs_in_a_scene_without_a_cube_are_refused(tmp_path: Path) -> None:
    files = read_arm_files(read_arm(made(tmp_path, TWO_JOINTS)))
    require_cell(files, ())
    with pytest.raises(ArmFileError, match=r"scene\.xml: the scene has no joint cube"):
        require_cell(files, ["A"])


def test_a_urdf_whose_name_is_not_utf8_becomes_an_arm(tmp_path: Path) -> None:
    urdf = tmp_path / os.fsdecode(b"r\xfc.urdf")
    urdf.write_text(TWO_JOINTS)
    assert RUNNER.invoke(cli.app, ["arms", "new", str(tmp_path / "mine"), str(urdf)]).exit_code == 0
    assert read_arm(tmp_path / "mine").file.description == "mine, from r\\udcfc.urdf"
