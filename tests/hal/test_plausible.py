"""Tests that implausible numbers and booleans in files are refused."""

from pathlib import Path

import pytest

from controller.parameters import ManagerParameters
from hal.errors import DescriptionError, RobotFileError
from hal.robot_description.description import parse_urdf
from hal.robot_file.robot_file import load_robot_file
from servoloop.stack.robot_files import CONFIG, URDF

ROBOT = """bus: {{baud: {baud}}}
joints:
  elbow: {{servo_id: 1, model: sts3215, acceleration: {acceleration}, jerk: {jerk}, torque_limit: {torque_limit}}}
park: {{pose: {{elbow: {position}}}, velocity_scale: {velocity_scale}}}
"""
GOOD = {"baud": 1000000, "acceleration": 10, "jerk": 100, "torque_limit": 1, "position": 0, "velocity_scale": 0.25}


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("acceleration", "true", "true is a boolean, but a number is required"),
        ("acceleration", "1.0e+9", "1e+09 is not a plausible acceleration: write 0.001 to 100000 rad/s"),
        ("jerk", "0.001", "0.001 is not a plausible jerk"),
        ("jerk", ".nan", "joints.elbow.jerk: Input should be"),
        ("velocity_scale", "1.0e-9", "1e-09 is not a plausible velocity scale"),
        ("torque_limit", "true", "true is a boolean"),
        ("baud", "7", "7 is not a plausible baud: write 1200 to 1e+07 bit/s"),
        ("baud", "true", "true is a boolean"),
        ("position", "1.0e+30", "1e+30 is not a plausible position"),
    ],
)
def test_implausible_values_in_a_robot_file(tmp_path: Path, key: str, value: str, message: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(ROBOT.format(**GOOD))
    load_robot_file(path)
    path.write_text(ROBOT.format(**{**GOOD, key: value}))
    with pytest.raises(RobotFileError) as error:
        load_robot_file(path)
    assert message in str(error.value)


@pytest.mark.parametrize("rate", [True, 0, 1001, 1e9])
def test_implausible_update_rates(rate: float) -> None:
    with pytest.raises(ValueError, match="update_rate"):
        ManagerParameters.model_validate({"update_rate": rate})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('velocity="', 'velocity="1e-9" was="', "velocity limit 1e-09 is not a plausible velocity"),
        ('effort="', 'effort="-3" was="', "effort limit -3"),
        ('upper="', 'upper="1e30" was="', "upper limit 1e+30 is not a plausible position"),
        ('rgba="', 'rgba="nan 0 0 1" was="', "is not 4 finite numbers"),
        ('rgba="', 'rgba="red" was="', 'color rgba="red" is not 4 finite numbers up to 1e+06 (arm.urdf, line '),
        ('size="', 'size="1 2" was="', 'box size="1 2" is not 3 finite numbers up to 1e+06 (arm.urdf, line '),
        (
            '<mass value="',
            '<mass value="1e9" was="',
            "mass 1e+09 is not a plausible mass: write 0 to 10000 kg (arm.urdf,",
        ),
        ('ixx="', 'ixx="1e9" was="', "ixx 1e+09 is not a plausible inertia"),
        ('ixy="', 'ixy="-1e9" was="', "ixy -1e+09 is not a plausible product of inertia"),
        (
            '<origin xyz="0 0 0.1"/>',
            '<origin rpy="1e9 0 0" xyz="0 0 0.1"/>',
            "is not a plausible angle: write -2000 to 2000 rad (arm.urdf, line ",
        ),
        ('xyz="', 'xyz="1e9 0 0" was="', "is not a plausible distance: write -1000 to 1000 m (arm.urdf, line "),
        ('<axis xyz="', '<axis xyz="1e-300 0 0" was="', "the length of <axis> 1e-300 is not a plausible axis length"),
        (
            '<state_interface name="position"/>',
            '<state_interface name="position"><param name="initial_value">1e9</param></state_interface>',
            "initial_value of joint1/position: 1e+09 is not a plausible position",
        ),
        ('<mimic joint="', '<mimic multiplier="1e9" was="1" joint="', "multiplier 1e+09 is not a plausible multiplier"),
        ('type="system"', 'type="system" rw_rate="' + "1" * 5000 + '"', "is not a whole number of hertz (arm.urdf"),
    ],
)
def test_implausible_values_in_a_urdf(old: str, new: str, message: str) -> None:
    xml = URDF.read_text()
    assert old in xml
    with pytest.raises(DescriptionError) as error:
        parse_urdf(xml.replace(old, new, 1), "arm.urdf")
    assert message in str(error.value)


TWICE = """name="arm2" type="system"><hardware><plugin>a/B</plugin></hardware>
<joint name="joint1"><command_interface name="position"/></joint></ros2_control>"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<ros2_control ", f"<ros2_control {TWICE}<ros2_control ", "joint 'joint1' is in two <ros2_control> blocks"),
        ("</ros2_control>", "</ros2_control><ros2_control/>", "a <ros2_control> block of the URDF has no name"),
        ('<joint name="hand_right_joint">', '<joint name="joint9">', "has joint 'joint9', which is not in the URDF"),
        ('<child link="link1"/>', "", "joint 'joint1' has no <child>"),
        ("<plugin>", "<other>x</other><plug>", "is not well-formed XML: mismatched tag: line"),
        ("<robot ", "<sdf ", "is not well-formed XML: mismatched tag: line"),
    ],
)
def test_a_mistake_in_a_urdf_is_reported_with_its_line(old: str, new: str, message: str) -> None:
    xml = URDF.read_text()
    assert old in xml
    with pytest.raises(DescriptionError) as error:
        parse_urdf(xml.replace(old, new), "arm.urdf")
    assert message in str(error.value) and ("arm.urdf, line " in str(error.value) or ": line " in str(error.value))


def test_the_files_of_all_arms_are_plausible() -> None:
    for path in sorted(CONFIG.glob("**/robot*.yaml")):
        if "calibration" not in path.name:
            load_robot_file(path)
