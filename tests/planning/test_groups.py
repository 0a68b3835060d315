"""Groups, end effectors and named states come from an SRDF or from the description of the arm."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from planning.groups import EndEffector, Groups, derive_groups
from planning.planning_errors import PlanningError
from planning.srdf_file import SrdfError, parse_srdf, read_srdf
from tests.planning.chains import ROOT, description

SRDF = ROOT / "config/moveit/robot_arm.srdf"
ARM = tuple(f"joint{number}" for number in range(1, 7))
FINGER = "hand_right_joint"


def parsed(*body: str) -> Groups:
    """Parse an SRDF whose body begins at line 2."""
    return parse_srdf("\n".join(['<robot name="robot_arm">', *body, "</robot>"]), description("robot_arm"), "arm.srdf")


def test_the_file_of_the_robot_arm() -> None:
    groups = read_srdf(SRDF, description("robot_arm"))
    arm, hand = groups.group("arm"), groups.group("hand")
    assert (arm.joints, arm.tip) == (ARM, "gripper_base_link")
    assert (hand.joints, hand.tip) == ((FINGER,), None)
    assert list(arm.states) == ["ready", "park", "upright"]
    assert arm.state("park") == dict(zip(ARM, (0.0, 0.3, 1.0, 0.95, 0.8, 0.0), strict=True))
    assert hand.states == {"open": {FINGER: 0.0}, "close": {FINGER: 0.05}}
    assert groups.end_effectors == {"hand": EndEffector("hand", "hand", "gripper_base_link", "arm")}


def test_derived_groups_equal_those_of_the_file() -> None:
    written = read_srdf(SRDF, description("robot_arm"))
    states = {"park": written.group("arm").state("park"), "open": written.group("hand").state("open")}
    found = derive_groups(description("robot_arm"), (*ARM, FINGER), "gripper_base_link", states)
    for name in ("arm", "hand"):
        assert found.group(name).joints == written.group(name).joints
        assert found.group(name).tip == written.group(name).tip
    assert found.end_effectors == written.end_effectors
    assert found.group("arm").states == {"park": states["park"]}
    assert found.group("hand").states == {"open": states["open"]}


def test_a_pose_of_all_joints_is_a_state_of_both_groups() -> None:
    arm = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
    pose = dict.fromkeys((*arm, "gripper"), 0.1)
    found = derive_groups(description("so101"), (*arm, "gripper"), "gripper_link", {"home": pose})
    assert found.group("arm").state("home") == dict.fromkeys(arm, 0.1)
    assert found.group("hand").state("home") == {"gripper": 0.1}


def test_an_arm_without_a_hand_has_one_group() -> None:
    found = derive_groups(description("robot_arm"), ARM, "gripper_base_link", {})
    assert list(found.groups) == ["arm"]
    assert not found.end_effectors


@pytest.mark.parametrize(
    ("driven", "tool", "states", "code", "message"),
    [
        (("elbow",), "link1", {}, "INVALID_ROBOT_STATE", "the URDF has no joint elbow: choose from joint1, joint2"),
        (ARM, "hand", {}, "INVALID_LINK_NAME", "the URDF has no link hand: choose one of base_link, link1"),
        (ARM, "base_link", {}, "INVALID_LINK_NAME", "no driven joint moves the tool base_link: choose a link such as"),
        (ARM, "link5", {"up": {"joint9": 0.0}}, "INVALID_ROBOT_STATE", "in state up, joint9 is not driven: choose"),
        (ARM, "link5", {"up": {"joint2": 2.1}}, "INVALID_ROBOT_STATE", "joint2 is at 2.1, outside its limits -2 to 2"),
        (ARM, "link5", {"up": {"joint2": float("nan")}}, "INVALID_ROBOT_STATE", "joint2 is at nan, outside its limits"),
    ],
)
def test_wrong_data_of_an_arm_are_refused(
    driven: Sequence[str], tool: str, states: dict[str, dict[str, float]], code: str, message: str
) -> None:
    with pytest.raises(PlanningError) as caught:
        derive_groups(description("robot_arm"), driven, tool, states)
    assert message in str(caught.value)
    assert caught.value.code == code


def test_unknown_names_are_refused_with_those_that_exist() -> None:
    groups = read_srdf(SRDF, description("robot_arm"))
    with pytest.raises(PlanningError, match="there is no group legs: choose one of arm, hand") as caught:
        groups.group("legs")
    assert caught.value.code == "INVALID_GROUP_NAME"
    with pytest.raises(PlanningError, match="the group arm has no state named up: choose one of ready, park, upright"):
        groups.group("arm").state("up")


@pytest.mark.parametrize(
    ("members", "joints"),
    [
        ('<joint name="joint1"/><joint name="hand_left_joint"/>', ("joint1",)),
        ('<link name="link2"/><link name="link1"/>', ("joint2", "joint1")),
        ('<chain base_link="link2" tip_link="link4"/><joint name="joint3"/>', ("joint3", "joint4")),
        ('<group name="other"/><joint name="joint1"/>', ("joint6", "joint1")),
    ],
)
def test_members_of_a_group(members: str, joints: tuple[str, ...]) -> None:
    found = parsed(f'<group name="one">{members}</group>', '<group name="other"><joint name="joint6"/></group>')
    assert found.group("one").joints == joints


def test_a_group_of_joints_has_its_tip_from_the_end_effector_and_no_passive_joints() -> None:
    found = parsed(
        '<group name="a"><joint name="joint1"/><joint name="joint2"/></group>',
        '<group name="h"><joint name="hand_right_joint"/></group>',
        '<end_effector name="e" group="h" parent_link="link2" parent_group="a"/>',
        '<passive_joint name="joint1"/>',
    )
    assert (found.group("a").joints, found.group("a").tip) == (("joint2",), "link2")


STATE = '<group_state name="s" group="a">{}</group_state>'


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('<group name="b"><joint name="joint9"/></group>', "line 3: there is no joint joint9: choose one of joint1"),
        ('<group name="b"><joint/></group>', "line 3: <joint> does not specify a joint: choose one of joint1"),
        ('<group name="b"><link name="hand"/></group>', "line 3: there is no link hand: choose one of base_link"),
        ('<group name="b"><group name="c"/></group>', "line 3: there is no group c: choose one of a, b"),
        ('<group name="b"><group name="b"/></group>', "line 3: group b contains itself: remove it from b"),
        ('<group name="b"><chain base_link="link1"/></group>', "line 3: a <chain> needs base_link and tip_link"),
        (
            '<group name="b"><chain base_link="link3" tip_link="link1"/></group>',
            "line 3: link1 does not descend",
        ),
        ('<group name="b"><chain base_link="link1" tip_link="up"/></group>', "line 3: the URDF has no link up"),
        ('<group name="b"/>', "line 3: group b has no joint that moves"),
        ('<group name="b"><tip/></group>', "line 3: group b has an unknown tag <tip>: remove it"),
        ("<group/>", "line 3: a <group> has no name: add a name"),
        ('<group name="a"><joint name="joint2"/></group>', "line 3: there are two <group> named a: rename one"),
        ('<group_state name="s" group="b"/>', "line 3: there is no group b: choose one of a"),
        ('<group_state group="a"/>', "line 3: a state of a has no name, or the same name as another state"),
        (STATE.format('<joint name="joint9" value="0"/>'), "line 3: there is no joint joint9: choose one of joint1"),
        (
            STATE.format('<joint name="joint2" value="0"/>'),
            "line 3: joint2 is not in group a: remove it from the state",
        ),
        (STATE.format('<joint name="joint1" value="up"/>'), 'line 3: joint1: value must be a number, not "up"'),
        (STATE.format('<joint name="joint1" value="nan"/>'), 'line 3: joint1: value must be a number, not "nan"'),
        (
            STATE.format('<joint name="joint1" value="3.2"/>'),
            "line 3: joint1 is at 3.2, outside its limits -3.05 to 3.05",
        ),
        ('<end_effector name="e" group="h" parent_link="link5"/>', "line 3: there is no group h: choose one of a"),
        ('<end_effector name="e" group="a" parent_link="no"/>', "line 3: there is no link no: choose one of base_link"),
        ("</robot><robot>", "arm.srdf is not well-formed XML: junk after document element: line 3"),
    ],
)
def test_a_mistake_is_reported_with_its_line(line: str, message: str) -> None:
    with pytest.raises(SrdfError) as caught:
        parsed('<group name="a"><joint name="joint1"/></group>', line)
    assert message in str(caught.value)
    assert str(caught.value).startswith("arm.srdf")


def test_all_mistakes_are_reported_at_once() -> None:
    with pytest.raises(SrdfError) as caught:
        parsed('<group name="a"><joint name="one"/></group>', '<end_effector name="e" group="b" parent_link="c"/>')
    assert [text.partition(":")[0] for text in str(caught.value).splitlines()] == [
        "arm.srdf, line 2",
        "arm.srdf, line 3",
    ]


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        ("<model/>", "the root of an SRDF is <robot>, not <model>"),
        ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include/></robot>', "is xacro, not SRDF"),
        ("<robot/>", "the SRDF has no <group>"),
    ],
)
def test_another_document_is_refused(xml: str, message: str) -> None:
    with pytest.raises(SrdfError, match=message):
        parse_srdf(xml, description("robot_arm"))


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SrdfError, match=r"no\.srdf"):
        read_srdf(tmp_path / "no.srdf", description("robot_arm"))
