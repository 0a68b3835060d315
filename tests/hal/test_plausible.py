"""Tests that implausible numbers and booleans in files are refused."""

from pathlib import Path

import pytest

from controller.parameters import ManagerParameters
from hal.hal_errors import DescriptionError, RobotFileError
from hal.robot_description.description import parse_urdf
from hal.robot_file.robot_file import load_robot_file
from servoloop.stack.shipped_files import CONFIG, URDF

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
        ("acceleration", "1.0e+9", "acceleration: must be 0.001 to 100000 rad/s² or m/s², not 1e+09"),
        ("jerk", "0.001", "jerk: must be 0.01 to 1e+07 rad/s³ or m/s³, not 0.001"),
        ("jerk", ".nan", "joints.elbow.jerk: must be"),
        ("velocity_scale", "1.0e-9", "velocity_scale: must be 0.001 to 1 of the velocity limit, not 1e-09"),
        ("torque_limit", "true", "true is a boolean"),
        ("baud", "7", "baud: must be 1200 to 1e+07 bit/s, not 7"),
        ("baud", "true", "true is a boolean"),
        ("position", "1.0e+30", "must be -2000 to 2000 rad or m, not 1e+30"),
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
        ('velocity="', 'velocity="1e-9" was="', "velocity limit must be 0.0001 to 10000 rad/s or m/s, not 1e-09"),
        ('effort="', 'effort="-3" was="', "effort limit must be above 0, not -3"),
        ('upper="', 'upper="1e30" was="', "upper limit must be -2000 to 2000 rad or m, not 1e+30"),
        ('rgba="', 'rgba="nan 0 0 1" was="', 'color rgba must be 4 finite numbers up to 1e+06, not "nan 0 0 1"'),
        ('rgba="', 'rgba="red" was="', 'color rgba must be 4 finite numbers up to 1e+06, not "red" (arm.urdf, line '),
        ('size="', 'size="1 2" was="', 'box size must be 3 finite numbers up to 1e+06, not "1 2" (arm.urdf, line '),
        (
            '<mass value="',
            '<mass value="1e9" was="',
            "mass must be 0 to 10000 kg, not 1e+09 (arm.urdf,",
        ),
        ('ixx="', 'ixx="1e9" was="', "ixx must be 0 to 1e+06 kg m², not 1e+09"),
        ('ixy="', 'ixy="-1e9" was="', "ixy must be -1e+06 to 1e+06 kg m², not -1e+09"),
        (
            '<origin xyz="0 0 0.1"/>',
            '<origin rpy="1e9 0 0" xyz="0 0 0.1"/>',
            "must be -2000 to 2000 rad, not 1e+09 (arm.urdf, line ",
        ),
        ('xyz="', 'xyz="1e9 0 0" was="', "must be -1000 to 1000 m, not 1e+09 (arm.urdf, line "),
        (
            '<axis xyz="',
            '<axis xyz="1e-300 0 0" was="',
            "the length of <axis> must be 1e-06 to 1e+06 (1 is usual), not 1e-300",
        ),
        (
            '<state_interface name="position"/>',
            '<state_interface name="position"><param name="initial_value">1e9</param></state_interface>',
            "initial_value of joint1/position must be -2000 to 2000 rad or m, not 1e+09",
        ),
        (
            '<mimic joint="',
            '<mimic multiplier="1e9" was="1" joint="',
            "multiplier must be -100000 to 100000 (1 is usual), not 1e+09",
        ),
        (
            'type="system"',
            'type="system" rw_rate="' + "1" * 5000 + '"',
            "rw_rate must be a whole number of hertz, not '1",
        ),
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
