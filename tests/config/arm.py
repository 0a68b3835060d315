"""Files of the arm for the tests of config/moveit."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from hal.robot_description.description import parse_urdf
from servoloop.moveit.surroundings import CollisionShape, Objects

ROOT: Final = Path(__file__).parents[2]
CONFIG: Final = ROOT / "config"
MOVEIT: Final = CONFIG / "moveit"
SRDF: Final = ElementTree.parse(MOVEIT / "robot_arm.srdf").getroot()
DESCRIPTION: Final = parse_urdf((ROOT / "urdf" / "robot_arm.urdf").read_text())
ARM: Final = [f"joint{i}" for i in range(1, 7)]
LINKS: Final = {"base_link"} | {joint.child for joint in DESCRIPTION.joints.values()}


def read(path: Path) -> Any:
    return yaml.safe_load(path.read_text())


def controllers() -> Any:
    return read(CONFIG / "arm_controllers.yaml")


def groups() -> dict[str, list[str]]:
    """Return the joints of each group, with chains followed from tip to base."""
    found: dict[str, list[str]] = {}
    for group in SRDF.findall("group"):
        joints = [joint.attrib["name"] for joint in group.findall("joint")]
        for chain in group.findall("chain"):
            joints += chain_joints(chain.attrib["base_link"], chain.attrib["tip_link"])
        found[group.attrib["name"]] = joints
    return found


def chain_joints(base: str, tip: str) -> list[str]:
    parents = {joint.child: joint for joint in DESCRIPTION.joints.values()}
    joints: list[str] = []
    while tip != base:
        joints.insert(0, parents[tip].name)
        tip = parents[tip].parent
    return joints


def states() -> dict[tuple[str, str], dict[str, float]]:
    return {
        (state.attrib["group"], state.attrib["name"]): {
            joint.attrib["name"]: float(joint.attrib["value"]) for joint in state.findall("joint")
        }
        for state in SRDF.findall("group_state")
    }


def read_objects(request: Mapping[str, Any]) -> Objects:
    """Return the objects of a request to /apply_planning_scene."""
    found: Objects = {}
    for item in request["scene"]["world"]["collision_objects"]:
        found[item["id"]] = [
            CollisionShape(
                primitive["type"],
                tuple(map(float, primitive["dimensions"])),
                tuple(float(pose["position"][axis]) for axis in "xyz"),
                tuple(float(pose.get("orientation", {"w": 1.0}).get(axis, 0.0)) for axis in "xyzw"),
            )
            for primitive, pose in zip(item["primitives"], item["primitive_poses"], strict=True)
        ]
    return found


def read_padding_m(folder: Path) -> float:
    """Return the padding that a folder with MoveIt's files sets, in m."""
    padding: float = yaml.safe_load((folder / "joint_limits.yaml").read_text())["default_robot_padding"]
    return padding
