"""The URDF and the MuJoCo scene describe the same arm, and the URDF is valid for ros2_control."""

import math
import xml.etree.ElementTree as ET
from typing import Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_backend.scene.world import SCENE, World

URDF: Final = SCENE.with_name("robot_arm.urdf")
ROOT: Final = ET.parse(URDF).getroot()
JOINTS: Final = {joint.get("name", ""): joint for joint in ROOT.findall("joint") if joint.get("type") != "fixed"}
ALL: Final = [*(f"joint{i}" for i in range(1, 7)), "hand_right_joint", "hand_left_joint"]


def numbers(element, key, default="0 0 0"):
    return np.array([float(x) for x in (element.get(key, default) if element is not None else default).split()])


def limits(name):
    limit = JOINTS[name].find("limit")
    return float(limit.get("lower")), float(limit.get("upper"))


def rotation(axis, angle):
    """Return the rotation by `angle` about a unit vector (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def forward(values):
    """Return the poses of the links (rotation, position), computed only from the URDF."""
    poses = {"base_link": (np.eye(3), np.zeros(3))}
    for name in ALL:  # parents come before their children
        joint = JOINTS[name]
        turned, moved = poses[joint.find("parent").get("link")]
        axis, value = numbers(joint.find("axis"), "xyz"), values[name]
        moved = moved + turned @ numbers(joint.find("origin"), "xyz")
        if joint.get("type") == "prismatic":
            moved = moved + turned @ axis * value
        else:
            turned = turned @ rotation(axis, value)
        poses[joint.find("child").get("link")] = turned, moved
    return poses


def test_joints_match_the_specification():
    assert list(JOINTS) == ALL
    assert all(JOINTS[f"joint{i}"].get("type") == "revolute" for i in range(1, 7))
    assert JOINTS["hand_left_joint"].find("mimic").get("joint") == "hand_right_joint"
    assert limits("hand_right_joint") == (0.0, 0.05)


def test_every_joint_has_the_range_of_the_scene_and_limits_of_its_servo():
    world = World()
    for name in ALL:
        assert tuple(world.model.joint(name).range) == limits(name)
        limit = JOINTS[name].find("limit")
        hand = name.startswith("hand")
        assert float(limit.get("velocity")) <= (0.09 if hand else 4.71)
        assert hand or float(limit.get("effort")) <= 2.94


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7))
def test_forward_kinematics_agree(shares):
    ranges = [limits(name) for name in ALL[:7]]
    position = [low + share * (high - low) for (low, high), share in zip(ranges, shares, strict=True)]
    values = dict(zip(ALL[:7], position, strict=True))
    world = World(initial_position=position)
    for link, (turned, moved) in forward({**values, "hand_left_joint": position[6]}).items():
        body = world.data.body(link)
        np.testing.assert_allclose(body.xpos, moved, atol=1e-6)
        np.testing.assert_allclose(body.xmat.reshape(3, 3), turned, atol=1e-6)


@pytest.mark.parametrize(
    "link", [link.get("name") for link in ROOT.findall("link") if link.find("inertial") is not None]
)
def test_masses_and_shapes_agree(link):
    model, element = World().model, ROOT.find(f"link[@name='{link}']")
    body, inertial = model.body(link), element.find("inertial")
    assert body.mass[0] == pytest.approx(float(inertial.find("mass").get("value")))
    np.testing.assert_allclose(body.ipos, numbers(inertial.find("origin"), "xyz"), atol=1e-9)
    inertia = [float(inertial.find("inertia").get(key)) for key in ("ixx", "iyy", "izz")]
    np.testing.assert_allclose(body.inertia, inertia, rtol=1e-6)
    first = body.geomadr[0]
    collisions = element.findall("collision")
    assert len(collisions) == body.geomnum[0] == len(element.findall("visual"))
    for i, collision in enumerate(collisions):
        np.testing.assert_allclose(model.geom_pos[first + i], numbers(collision.find("origin"), "xyz"), atol=1e-9)
        np.testing.assert_allclose(model.geom_size[first + i], sizes(collision.find("geometry")[0]), atol=1e-9)


def sizes(shape):
    """Return the half sizes that MuJoCo uses for a URDF primitive."""
    if shape.tag == "box":
        return numbers(shape, "size") / 2
    assert shape.tag == "cylinder"
    return [float(shape.get("radius")), float(shape.get("length")) / 2, 0.0]


def test_the_ros2_control_block():
    (block,) = ROOT.findall("ros2_control")
    assert (block.get("name"), block.get("type")) == ("robot_arm", "system")
    assert block.find("hardware/plugin").text == "servoloop/ServoHardware"
    assert {p.get("name"): p.text for p in block.findall("hardware/param")} == {"robot": "robot_arm.yaml"}
    interfaces = {
        joint.get("name"): (
            [i.get("name") for i in joint.findall("command_interface")],
            [i.get("name") for i in joint.findall("state_interface")],
        )
        for joint in block.findall("joint")
    }
    both = ["position", "velocity"]
    assert interfaces == {name: ([] if name == "hand_left_joint" else ["position"], both) for name in ALL}
