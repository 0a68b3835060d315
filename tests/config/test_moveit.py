"""Tests that robot_arm.srdf agrees with the URDF, the robot file and the controllers file."""

import xml.etree.ElementTree as ElementTree

import pytest

from tests.config.arm import ARM, CONFIG, DESCRIPTION, SRDF, controllers, groups, read, states


# Running the tests of this folder also runs the command below.
@pytest.mark.runs(".venv/bin/python -m pytest tests/config")
def test_the_robot_has_the_name_in_the_urdf() -> None:
    assert SRDF.get("name") == ElementTree.fromstring(DESCRIPTION.xml).get("name")


def test_groups_contain_the_joints_of_the_controllers() -> None:
    assert groups()["arm"] == controllers()["arm_controller"]["ros__parameters"]["joints"]
    driven = controllers()["hand_controller"]["ros__parameters"]["joints"]
    assert groups()["hand"] == [*driven, "hand_left_joint"]
    assert set(groups()) == {"arm", "hand"}
    assert {*groups()["arm"], *groups()["hand"]} == {
        joint.name for joint in DESCRIPTION.joints.values() if joint.kind != "fixed"
    }


def test_the_hand_is_the_end_effector_of_the_arm() -> None:
    (effector,) = SRDF.findall("end_effector")
    hand_parents = {DESCRIPTION.joints[joint].parent for joint in groups()["hand"]}
    assert hand_parents == {effector.get("parent_link")}
    assert (effector.get("group"), effector.get("parent_group")) == ("hand", "arm")
    assert DESCRIPTION.joints[groups()["arm"][-1]].child == effector.get("parent_link")


def test_mimic_joints_are_passive() -> None:
    mimics = {joint.name for joint in DESCRIPTION.joints.values() if joint.mimic}
    assert {joint.get("name") for joint in SRDF.findall("passive_joint")} == mimics == {"hand_left_joint"}


def test_named_states_name_every_driven_joint_of_their_group_within_its_limits() -> None:
    for (group, name), values in states().items():
        driven = [joint for joint in groups()[group] if not DESCRIPTION.joints[joint].mimic]
        assert list(values) == driven, name
        for joint, value in values.items():
            assert DESCRIPTION.joints[joint].lower <= value <= DESCRIPTION.joints[joint].upper, (name, joint)


def test_named_states_are_zero_the_park_pose_and_the_poses_of_the_node() -> None:
    node = read(CONFIG / "vision_pick_place_controller.yaml")["/**/vision_pick_place_controller"]["ros__parameters"]
    assert states() == {
        ("arm", "ready"): dict(zip(ARM, node["poses"]["ready"], strict=True)),
        ("arm", "park"): read(CONFIG / "robot_arm.yaml")["park"]["pose"],
        ("arm", "upright"): dict.fromkeys(ARM, 0.0),
        ("hand", "open"): {"hand_right_joint": node["hand_open_m"]},
        ("hand", "close"): {"hand_right_joint": node["hand_closed_m"]},
    }
