"""Tests of the URDF parser and of its messages about invalid files."""

import re
from pathlib import Path

import pytest

from hal.hal_errors import DescriptionError
from hal.robot_description.description import Mimic, merged, parse_urdf

URDF = Path(__file__).resolve().parents[2] / "urdf" / "robot_arm.urdf"

ELBOW = """
  <joint name="elbow" type="revolute">
    <parent link="a"/><child link="b"/>
    <origin xyz="1 2 3" rpy="0.1 0.2 0.3"/><axis xyz="0 -1 0"/>
    <limit lower="-1.5" upper="2" effort="3" velocity="4"/>
  </joint>"""
FINGER = """
  <joint name="finger" type="prismatic">
    <parent link="b"/><child link="c"/>
    <limit lower="0" upper="0.05" effort="3" velocity="0.2"/>
    <mimic joint="elbow" multiplier="-2" offset="0.5"/>
  </joint>"""
CONTROL = """
  <ros2_control name="arm" type="system">
    <hardware><plugin> servoloop/ServoHardware </plugin><param name="robot">arm.yaml</param></hardware>
    <joint name="elbow"><command_interface name="position"/><state_interface name="position"/></joint>
    <joint name="finger"><state_interface name="position"/></joint>
  </ros2_control>"""

STATE = '<state_interface name="position"/>'
INITIAL = '<state_interface name="position"><param name="initial_value">{}</param></state_interface>'


def urdf(joints: str = ELBOW + FINGER, control: str = CONTROL) -> str:
    return f'<?xml version="1.0" encoding="utf-8"?>\n<robot name="r">{joints}{control}</robot>'


def test_a_joint() -> None:
    elbow = parse_urdf(urdf()).joints["elbow"]
    assert (elbow.kind, elbow.parent, elbow.child) == ("revolute", "a", "b")
    assert (elbow.xyz_m, elbow.rpy_rad, elbow.axis) == ((1, 2, 3), (0.1, 0.2, 0.3), (0, -1, 0))
    assert (elbow.lower, elbow.upper, elbow.velocity) == (-1.5, 2.0, 4.0)
    assert elbow.mimic is None


def test_default_values_of_a_joint() -> None:
    finger = parse_urdf(urdf()).joints["finger"]
    assert (finger.xyz_m, finger.rpy_rad, finger.axis) == ((0, 0, 0), (0, 0, 0), (1, 0, 0))
    assert finger.mimic == Mimic("elbow", -2.0, 0.5)
    plain = FINGER.replace(' multiplier="-2" offset="0.5"', "")
    assert parse_urdf(urdf(ELBOW + plain)).joints["finger"].mimic == Mimic("elbow", 1.0, 0.0)


def test_the_hardware_component() -> None:
    (component,) = parse_urdf(urdf()).components
    assert (component.name, component.kind, component.plugin) == ("arm", "system", "servoloop/ServoHardware")
    assert component.parameters == {"robot": "arm.yaml"}
    assert component.joints == ("elbow",)
    assert component.command_interfaces == {"elbow": ("position",), "finger": ()}
    assert component.state_interfaces == {"elbow": ("position",), "finger": ("position",)}


def test_interfaces_by_their_full_names() -> None:
    (component,) = parse_urdf(urdf()).components
    assert component.commands == ("elbow/position",)
    assert component.states == ("elbow/position", "finger/position")
    assert component.mimics == {"finger"}


@pytest.mark.parametrize(
    ("old", "new", "rate_hz"),
    [
        ('type="system"', 'type="system"', 0),
        ('type="system"', 'type="system" rw_rate="25"', 25),
        ("</plugin>", '</plugin><param name="rw_rate">5</param>', 5),
    ],
)
def test_a_component_may_have_its_own_rate(old: str, new: str, rate_hz: int) -> None:
    (component,) = parse_urdf(urdf(control=CONTROL.replace(old, new))).components
    assert component.rw_rate == rate_hz


def test_initial_values() -> None:
    (component,) = parse_urdf(urdf(control=CONTROL.replace(STATE, INITIAL.format("0.25"), 1))).components
    assert component.initial_values == {"elbow/position": 0.25}


def test_several_components() -> None:
    wrist = ELBOW.replace("elbow", "wrist")
    other = CONTROL.replace('"arm"', '"hand"').replace("elbow", "wrist").replace('<joint name="finger">', "<!--", 1)
    other = other.replace("</joint>\n  </ros2", "-->\n  </ros2")
    components = parse_urdf(urdf(ELBOW + FINGER + wrist, CONTROL + other)).components
    assert [(c.name, c.joints) for c in components] == [("arm", ("elbow",)), ("hand", ("wrist",))]
    whole = merged(components)
    assert whole.joints == ("elbow", "wrist")
    assert whole.commands == ("elbow/position", "wrist/position")
    assert whole.mimics == {"finger"}
    assert whole.node_names == ("arm", "hand")
    assert merged(components[:1]) is components[0]


def test_the_text_of_the_urdf_is_kept() -> None:
    assert parse_urdf(urdf()).xml == urdf()


def test_the_urdf_of_the_robot_arm() -> None:
    description = parse_urdf(URDF.read_text())
    (component,) = description.components
    assert component.joints == (*(f"joint{i}" for i in range(1, 7)), "hand_right_joint")
    hand = description.joints["hand_right_joint"]
    assert (hand.kind, hand.lower, hand.upper) == ("prismatic", 0.0, 0.05)
    left = description.joints["hand_left_joint"].mimic
    assert left is not None and left.joint == "hand_right_joint"
    assert {description.joints[f"joint{i}"].kind for i in range(1, 7)} == {"revolute"}
    for name in component.joints:
        joint = description.joints[name]
        assert joint.lower < joint.upper and joint.velocity > 0.0, name
    children = {joint.child for joint in description.joints.values()}
    assert {"gripper_base_link"} <= children and "base_link" not in children


LINKS = '<link name="a"/><link name="b"><inertial><mass value="0.2"/>{}</inertial></link><link name="c"/>'


def limited(old: str, new: str) -> str:
    return urdf(ELBOW.replace(old, new, 1) + FINGER)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            limited('"-1.5" upper="2"', '"2" upper="-1.5"'),
            "elbow: lower limit 2.0 is above upper limit -1.5 (arm.urdf, line 6): swap them.",
        ),
        (
            urdf(ELBOW + FINGER.replace('"0" upper="0.05"', '"0" upper="-0.04"')),  # the joint has no commands
            "finger: lower limit 0.0 is above upper limit -0.04 (arm.urdf, line 10): swap them.",
        ),
        (
            limited('"-1.5" upper="2"', '"2" upper="2"'),
            "elbow: lower limit 2.0 equals upper limit 2.0 (arm.urdf, line 6), so the joint cannot move: set its",
        ),
        (
            limited('lower="-1.5" upper="2" ', ""),
            "elbow: lower limit 0.0 equals upper limit 0.0 (arm.urdf, line 6), so the joint cannot move: set its",
        ),
        (limited(' velocity="4"', ""), "elbow: velocity limit must be above 0, not 0.0 (arm.urdf, line 6): write the"),
        (
            limited('velocity="4"', 'velocity="-4"'),
            "elbow: velocity limit must be above 0, not -4.0 (arm.urdf, line 6)",
        ),
        (limited('effort="3"', 'effort="-3"'), "elbow: effort limit must be above 0, not -3.0 (arm.urdf, line 6)"),
        (limited('effort="3"', 'effort="inf"'), "joint 'elbow': effort must be a number, not 'inf' (arm.urdf, line 6)"),
        (limited('"-1.5"', '"nan"'), "joint 'elbow': lower must be a number, not 'nan' (arm.urdf, line 6)"),
        (limited("-1.5", "-90deg"), "joint 'elbow': lower must be a number, not '-90deg' (arm.urdf, line 6)"),
        (
            urdf(re.sub("<limit.*", "", ELBOW) + FINGER),
            "joint 'elbow' is revolute but has no <limit> (arm.urdf, line 3): add a <limit> with lower, upper and",
        ),
        (
            urdf(re.sub('"revolute"', '"continuous"', ELBOW).replace("<limit", "<other") + FINGER),
            "elbow: velocity limit must be above 0, not 0.0 (arm.urdf, line 3)",
        ),
        (
            urdf(ELBOW + FINGER.replace('joint="elbow" ', 'joint="finger" ')),
            "finger: the chain of <mimic> elements leads back to finger (arm.urdf, line 10): mimic a driven joint",
        ),
        (urdf(LINKS.format("") + '<link name="a"/>' + ELBOW + FINGER), "two links named 'a' (arm.urdf, line 2)"),
        (
            urdf(LINKS.format("") + ELBOW.replace('child link="b"', 'child link="B"') + FINGER),
            "elbow: link B is not in the URDF (arm.urdf, line 6): correct its name, or add the link",
        ),
        (
            urdf(LINKS.format("") + ELBOW + FINGER.replace('child link="c"', 'child link="b"')),
            "elbow and finger have the same child link, b (arm.urdf, line 10): rename one",
        ),
        (
            urdf(LINKS.format("") + ELBOW + FINGER.replace('child link="c"', 'child link="a"')),
            "finger: its child link a is an ancestor of its parent link b, so the links form a loop (arm.urdf",
        ),
        (
            urdf(LINKS.format("").replace('"0.2"', '"-0.2"') + ELBOW + FINGER),
            "link 'b': mass must be at least 0, not -0.2 (arm.urdf, line 2)",
        ),
        (
            urdf(LINKS.format("").replace('"0.2"', '"200g"') + ELBOW + FINGER),
            "link 'b': mass must be a number, not '200g' (arm.urdf, line 2)",
        ),
        (
            urdf(LINKS.format('<inertia ixx="nan"/>') + ELBOW + FINGER),
            "link 'b': ixx must be a number, not 'nan' (arm.urdf, line 2)",
        ),
        (
            urdf(LINKS.format('<inertia izz="-1e-4"/>') + ELBOW + FINGER),
            "link 'b': izz must be at least 0, not -0.0001 (arm.urdf, line 2)",
        ),
    ],
)
def test_invalid_limits_links_and_masses_are_reported_with_their_line(text: str, message: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        parse_urdf(text, "arm.urdf")
    (sentence,) = str(caught.value).splitlines()
    assert message in sentence


def test_all_wrong_limits_are_reported_together() -> None:
    with pytest.raises(DescriptionError) as caught:
        parse_urdf(limited('"-1.5" upper="2" effort="3" velocity="4"', '"2" upper="-1.5" effort="-1" velocity="0"'))
    assert [line.partition(" limit ")[0] for line in str(caught.value).splitlines()] == [
        "elbow: lower",
        "elbow: velocity",
        "elbow: effort",
    ]


def test_an_unknown_effort_only_matters_for_effort_commands() -> None:
    unknown = limited('effort="3"', 'effort="0"')
    assert parse_urdf(unknown).joints["elbow"].effort == 0.0
    with pytest.raises(DescriptionError, match=r"elbow: effort limit must be above 0, not 0.0"):
        parse_urdf(unknown.replace('<command_interface name="position"/>', '<command_interface name="effort"/>', 1))


def test_a_joint_without_commands_needs_no_limits() -> None:
    passive = ELBOW.replace('lower="-1.5" upper="2" effort="3" velocity="4"', "")
    control = CONTROL.replace('<command_interface name="position"/>', "")
    assert parse_urdf(urdf(passive + FINGER, control)).joints["elbow"].velocity == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the URDF is not well-formed XML"),
        ("<robot", "the URDF is not well-formed XML"),
        ("<sdf/>", "the URDF's root is <sdf>, not <robot>"),
        (
            urdf(control=""),
            "the URDF has no <ros2_control> block: add a block with <hardware><plugin>servoloop/ServoHardware</plugin>",
        ),
        (urdf(ELBOW.replace(' name="elbow"', "")), "a joint of the URDF has no name"),
        (urdf(ELBOW.replace(' type="revolute"', "")), "joint 'elbow' of the URDF has no type"),
        (urdf(ELBOW.replace('<parent link="a"/>', "")), "joint 'elbow' has no <parent>"),
        (urdf(ELBOW.replace('<child link="b"/>', "<child/>")), "<child> of joint 'elbow' of the URDF has no link"),
        (urdf(re.sub("<limit.*", "", ELBOW)), "joint 'elbow' is revolute but has no <limit>"),
        (urdf(ELBOW + re.sub("<limit.*", "", FINGER)), "joint 'finger' is prismatic but has no <limit>"),
        (urdf(ELBOW.replace("-1.5", "low")), "joint 'elbow': lower must be a number, not 'low'"),
        (urdf(ELBOW.replace("-1.5", "nan")), "joint 'elbow': lower must be a number, not 'nan'"),
        (urdf(ELBOW.replace('"4"', '"inf"')), "joint 'elbow': velocity must be a number, not 'inf'"),
        (urdf(ELBOW.replace("1 2 3", "1 2")), "joint 'elbow': xyz must be three numbers, not '1 2'"),
        (urdf(ELBOW.replace("1 2 3", "1 2 3 4")), "joint 'elbow': xyz must be three numbers, not '1 2 3 4'"),
        (urdf(ELBOW.replace("1 2 3", "1 2 nan")), "joint 'elbow': xyz must be three numbers, not '1 2 nan'"),
        (urdf(ELBOW.replace("0 -1 0", "0 0 0")), "joint 'elbow': the <axis> is zero"),
        (urdf(ELBOW + ELBOW + FINGER), "the URDF has two joints named 'elbow'"),
        (urdf(ELBOW + FINGER.replace('mimic joint="elbow"', "mimic")), "<mimic> of joint 'finger' of the URDF has no"),
        (
            urdf(ELBOW + FINGER.replace('mimic joint="elbow"', 'mimic joint="thumb"')),
            "joint 'finger' mimics 'thumb', which is not in the URDF",
        ),
        (urdf(ELBOW), "<ros2_control name='arm'> has joint 'finger', which is not in the URDF"),
        (urdf(control=CONTROL.replace(' name="arm"', "")), "a <ros2_control> block of the URDF has no name"),
        (urdf(control=CONTROL.replace(' type="system"', "")), "<ros2_control name='arm'> of the URDF has no type"),
        (urdf(control=re.sub("<hardware>.*", "", CONTROL)), "<ros2_control name='arm'> has no <hardware><plugin>"),
        (urdf(control=re.sub("<plugin>.*</plugin>", "", CONTROL)), "<ros2_control name='arm'> has no <hardware><plugi"),
        (urdf(control=re.sub("<plugin>.*</plugin>", "<plugin> </plugin>", CONTROL)), "has no <hardware><plugin>"),
        (urdf(control=CONTROL.replace('<param name="robot">', "<param>")), "a <param> of the URDF has no name"),
        (
            urdf(control=CONTROL.replace('<command_interface name="position"/>', "<command_interface/>")),
            "a <command_interface> of the URDF has no name",
        ),
        (
            urdf(control=CONTROL.replace('"system"', '"robot"')),
            "<ros2_control name='arm'> has unknown type 'robot' (the URDF, line",
        ),
        (
            urdf(control=CONTROL.replace("<hardware>", "<software/><hardware>")),
            "<ros2_control name='arm'> has the unknown tag <software>",
        ),
        (
            urdf(ELBOW.replace("revolute", "fixed") + FINGER),
            "<ros2_control name='arm'> has joint 'elbow', which is fixed in the URDF (the URDF, line",
        ),
        (
            urdf(
                control=CONTROL.replace('<joint name="finger">', '<joint name="finger"><command_interface name="x"/>')
            ),
            "joint 'finger' has a <command_interface> but mimics 'elbow'",
        ),
        (
            urdf(control=CONTROL.replace('"system"', '"sensor"')),
            "<ros2_control name='arm'> is a sensor, but joint 'elbow' has a <command_interface>",
        ),
        (
            urdf(control=CONTROL.replace('<state_interface name="position"/>', STATE + STATE, 1)),
            "joint 'elbow' has <state_interface name='position'> twice",
        ),
        (
            urdf(control=CONTROL.replace('name="finger"', 'name="elbow"')),
            "<ros2_control name='arm'> has joint 'elbow' tw",
        ),
        (urdf(control=CONTROL + CONTROL), "two <ros2_control> blocks are named 'arm'"),
        (
            urdf(control=CONTROL.replace('"arm"', '"controller_manager"')),
            "<ros2_control name='controller_manager'> (the URDF, line 13) has the name of the stack's own node",
        ),
        (
            urdf(control=CONTROL.replace('"arm"', f'"{"é" * 101}"')),
            "(the URDF, line 13) has a name of 101 characters: shorten it to at most 100",
        ),
        (
            urdf(control=CONTROL.replace('"arm"', '"arm-1"') + CONTROL.replace('"arm"', '"arm_1"')),
            "<ros2_control name='arm_1'> (the URDF, line 18) has the node name arm_1, as has 'arm-1': rename one block",
        ),
        (
            urdf(control=CONTROL + CONTROL.replace('"arm"', '"hand"')),
            "joint 'elbow' is in two <ros2_control> blocks",
        ),
        (
            urdf(control=re.sub('<joint name="elbow">.*?</joint>', "", CONTROL)),
            "joint 'finger' mimics 'elbow', which is not in a <ros2_control> block",
        ),
        (
            urdf(control=CONTROL.replace('type="system"', 'type="system" rw_rate="often"')),
            "<ros2_control name='arm'>: rw_rate must be a whole number of hertz, not 'often'",
        ),
        (
            urdf(control=CONTROL.replace(STATE, INITIAL.format("far"), 1)),
            "initial_value of elbow/position must be a number, not 'far'",
        ),
        (
            urdf(control=CONTROL.replace(STATE, INITIAL.format("nan"), 1)),
            "initial_value of elbow/position must be a number, not 'nan'",
        ),
    ],
)
def test_messages_about_an_invalid_urdf(text: str, message: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        parse_urdf(text)
    assert message in str(caught.value)


DRIVEN_FINGER = CONTROL.replace(
    f'<joint name="finger">{STATE}', f'<joint name="finger" mimic="false"><command_interface name="position"/>{STATE}'
)


def test_a_block_may_drive_a_mimic_joint_with_mimic_false() -> None:
    description = parse_urdf(urdf(control=DRIVEN_FINGER))
    (component,) = description.components
    assert component.joints == ("elbow", "finger")
    assert component.mimics == frozenset()
    assert description.joints["finger"].mimic is None


@pytest.mark.parametrize(
    ("control", "message"),
    [
        (DRIVEN_FINGER.replace('mimic="false"', 'mimic="no"'), "joint 'finger': mimic must be true or false, not 'no'"),
        (DRIVEN_FINGER.replace('mimic="false"', 'mimic="true"'), "has a <command_interface> but mimics 'elbow'"),
        (
            CONTROL.replace('<joint name="elbow">', '<joint name="elbow" mimic="true">'),
            "joint 'elbow' has mimic=\"true\" but no <mimic> in the URDF (the URDF, line",
        ),
    ],
)
def test_invalid_mimic_attributes_are_refused(control: str, message: str) -> None:
    with pytest.raises(DescriptionError) as error:
        parse_urdf(urdf(control=control))
    assert message in str(error.value)


def test_a_chain_of_mimic_joints_follows_the_driven_joint() -> None:
    thumb, tip = (
        FINGER.replace('"finger"', f'"{name}"').replace('"c"', f'"{name}_link"').replace('"elbow"', f'"{led}"')
        for name, led in (("thumb", "finger"), ("tip", "thumb"))
    )
    joints = parse_urdf(urdf(ELBOW + tip + thumb + FINGER)).joints
    assert joints["thumb"].mimic == Mimic("elbow", 4.0, -0.5)
    assert joints["tip"].mimic == Mimic("elbow", -8.0, 1.5)


@pytest.mark.parametrize(
    "xml",
    [
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="arm.xacro"/></robot>',
        '<robot name="r"><xacro:include filename="arm.xacro"/></robot>',
        '<robot name="r"><link name="${prefix}base"/></robot>',
    ],
)
def test_xacro_is_refused_with_the_command_that_expands_it(xml: str) -> None:
    with pytest.raises(DescriptionError, match=r"this file is xacro.*: run 'xacro FILE > robot.urdf'"):
        parse_urdf(xml)
