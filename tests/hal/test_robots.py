"""Tests of several components, each with its own robot file, that form one robot."""

from pathlib import Path

import pytest

from hal.hal_errors import RobotFileError
from hal.joint import Joint
from hal.robot_description.description import Description, UrdfJoint
from hal.robot_description.hardware_info import HardwareInfo
from hal.robot_file.robot import Robot, assemble
from hal.robot_file.robot_file import RobotFile, load_robot_file
from hal.robot_file.robots import all_limits, limits_of, together

FILE = """\
joints:
  {name}: {{servo_id: 1, model: sts3215, acceleration: 12, jerk: 120}}
on_exit: {{virtual: {exit}}}
park: {{pose: {{{name}: 0.1}}, velocity_scale: {scale}}}
controller_defaults: {{arm_controller: {{{name}: 1}}}}
"""


def urdf(name: str) -> UrdfJoint:
    return UrdfJoint(name, "revolute", "a", "b", (0, 0, 0), (0, 0, 0), (0, 0, 1), -1.5, 1.5, 4.0, None, 3.0)


def part(
    folder: Path, component: str, joint: str, *, exit_policy: str = "hold", scale: float = 0.5, bus: str = ""
) -> tuple[HardwareInfo, Robot]:
    path = folder / f"{joint}.yaml"
    text = FILE.format(name=joint, exit=exit_policy, scale=scale)
    path.write_text(f"buses: {{{bus}: {{baud: 500000}}}}\n{text}" if bus else text)
    made = HardwareInfo(component, "system", "p", {}, {joint: ("position",)}, {})
    return made, assemble(load_robot_file(path), Description("", {joint: urdf(joint)}, (made,)), made)


def names(joints: tuple[Joint, ...]) -> list[tuple[str, str]]:
    return [(joint.name, joint.address) for joint in joints]


def test_a_single_robot_is_unchanged(tmp_path: Path) -> None:
    arm = part(tmp_path, "arm", "elbow")
    assert together([arm]) is arm[1]
    assert names(arm[1].joints) == [("elbow", "1")]


def test_each_bus_is_named_after_its_component(tmp_path: Path) -> None:
    robot = together([part(tmp_path, "arm", "elbow"), part(tmp_path, "the hand", "finger", bus="left", scale=0.2)])
    assert names(robot.joints) == [("elbow", "arm/1"), ("finger", "the_hand-left/1")]
    assert {name: line.baud for name, line in robot.file.lines().items()} == {
        "arm": 1_000_000,
        "the_hand-left": 500_000,
    }
    assert list(robot.file.joints_on("the_hand-left")) == ["finger"]
    assert robot.file.park is not None
    assert (robot.file.park.pose, robot.file.park.velocity_scale) == ({"elbow": 0.1, "finger": 0.1}, 0.2)
    assert robot.file.controller_defaults == {"arm_controller": {"elbow": 1, "finger": 1}}


def test_two_buses_never_get_the_same_name(tmp_path: Path) -> None:
    parts = [part(tmp_path, "hand", "elbow", bus="left"), part(tmp_path, "hand-left", "finger")]
    with pytest.raises(RobotFileError, match="two buses are called hand-left: rename component hand or hand-left"):
        together(parts)


def test_no_component_with_servos_is_called_world(tmp_path: Path) -> None:
    message = "a component with servos must not be called world, .*: rename the component in the URDF"
    with pytest.raises(RobotFileError, match=message):
        together([part(tmp_path, "arm", "elbow"), part(tmp_path, "world", "finger")])


def test_components_without_joints_have_no_bus(tmp_path: Path) -> None:
    box = HardwareInfo("box", "system", "p", {}, {}, {}), Robot((), RobotFile(joints={}))
    assert list(together([part(tmp_path, "arm", "elbow"), box]).file.lines()) == ["arm"]
    assert together([box, box]).joints == ()


def test_on_exit_must_be_the_same_in_all_robot_files(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="the robot files of arm and hand differ in on_exit"):
        together([part(tmp_path, "arm", "elbow"), part(tmp_path, "hand", "finger", exit_policy="relax")])


def test_a_joint_that_is_only_measured_needs_no_limits() -> None:
    joints = {name: urdf(name) for name in ("elbow", "probe")}
    component = HardwareInfo("arm", "system", "p", {}, {"elbow": ("position",), "probe": ()}, {})
    assert list(all_limits([component], together([]), joints)) == ["elbow"]


def test_no_components() -> None:
    assert together([]).joints == ()


def test_a_joint_without_a_servo_has_the_urdfs_limits() -> None:
    limits = limits_of(urdf("elbow"))
    assert (limits.lower, limits.upper, limits.velocity, limits.effort) == (-1.5, 1.5, 4.0, 3.0)
    assert (limits.acceleration, limits.jerk) == (16.0, 160.0)
