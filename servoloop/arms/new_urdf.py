"""Generate the URDF of a new arm: the user's URDF with a <ros2_control> block for servoloop."""

import io
import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isfinite, pi
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

from drivers.paths import resolved
from drivers.servos.register import ServoModel
from hal.hal_errors import ArmFileError, DescriptionError
from hal.robot_description.description import parse_urdf
from hal.robot_description.description_check import MOVING
from hal.robot_description.urdf import UrdfJoint
from hal.text_file import read_xml

PLUGIN: Final = "servoloop/ServoHardware"
ROBOT_FILE: Final = "robot.yaml"
PROLOG: Final = re.compile(r"(?:\s+|<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^>]*>)*", re.DOTALL)
HAND: Final = re.compile(r"grip|jaw|finger|hand|claw|knuckle", re.IGNORECASE)
"""Pattern for the names of joints that belong to a hand."""
REACH_SHARE: Final = 0.98
"""Maximum fraction of the servo's count range that a joint may use."""
HAND_TRAVEL_RAD: Final = 2.5
"""Angle by which a servo turns to open a hand with two sliding fingers, in rad."""


@dataclass(frozen=True, slots=True)
class NewDescription:
    """New URDF and its driven joints, with the hand's joints last."""

    xml: str
    joints: tuple[UrdfJoint, ...]

    @property
    def hand(self) -> tuple[UrdfJoint, ...]:
        """Joints of the hand."""
        return tuple(joint for joint in self.joints if _is_hand(joint))

    @property
    def arm(self) -> tuple[UrdfJoint, ...]:
        """Joints of the arm without the hand, or all joints if every joint has a hand joint's name."""
        return tuple(joint for joint in self.joints if not _is_hand(joint)) or self.joints


def new_description(urdf: Path, folder: Path, name: str, model: ServoModel) -> NewDescription:
    """Return the description of a new arm without writing files.

    Args:
        urdf: The user's URDF.
        folder: Folder of the new URDF. Paths of meshes become relative to this folder.
        name: Name of the <ros2_control> block.
        model: Servo model of all joints. Its count range limits the commands.

    Raises:
        ArmFileError: None of the joints can be driven.
        DescriptionError: The URDF has errors.
    """
    text = read_xml(urdf, DescriptionError, "the URDF")
    # The URDF is checked before it is changed, so that messages refer to the user's line numbers.
    if "<ros2_control" not in text:
        _require_sound(text, urdf)
    robot = _parsed(text, urdf)
    wanted = {joint.get("name", "") for block in robot.findall("ros2_control") for joint in block.findall("joint")}
    for block in robot.findall("ros2_control"):
        robot.remove(block)
    driven = [joint for joint in _driven(robot) if not wanted or joint.get("name") in wanted]
    if not driven:
        raise ArmFileError(f"{urdf} has no joint that a servo could drive: a joint must be revolute or prismatic")
    reach_rad = REACH_SHARE * model.last_count / model.counts_per_turn * 2.0 * pi
    for joint in driven:
        _limit_endless(joint, reach_rad)
    keep_meshes(robot, resolved(urdf).parent, resolved(folder))
    robot.append(_block(name, driven, reach_rad))
    xml = _prolog(text) + ElementTree.tostring(robot, encoding="unicode") + "\n"
    joints = parse_urdf(xml, str(urdf)).joints
    ordered = [joints[joint.get("name", "")] for joint in driven]
    return NewDescription(xml, tuple(sorted(ordered, key=_is_hand)))


def metres_per_radian(joint: UrdfJoint) -> float | None:
    """Return the transmission with which ``HAND_TRAVEL_RAD`` moves a prismatic joint across its range; None for other
    joints."""
    return round((joint.upper - joint.lower) / HAND_TRAVEL_RAD, 6) if joint.kind == "prismatic" else None


def _is_hand(joint: UrdfJoint) -> bool:
    return joint.kind == "prismatic" or HAND.search(joint.name) is not None


def _require_sound(text: str, urdf: Path) -> None:
    """Check a URDF without a <ros2_control> block as if it had one. Raises DescriptionError."""
    end = text.rfind("</robot>")
    block = f'<ros2_control name="new" type="system"><hardware><plugin>{PLUGIN}</plugin></hardware></ros2_control>'
    try:
        parse_urdf(text if end < 0 else text[:end] + block + text[end:], str(urdf))
    except DescriptionError as error:
        lines = str(error).splitlines()
        raise DescriptionError("\n".join(one if str(urdf) in one else f"{urdf}: {one}" for one in lines)) from error


def _parsed(text: str, urdf: Path) -> Element:
    """Parse XML, keeping its comments. Raises DescriptionError."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    try:
        return ElementTree.parse(io.StringIO(text), parser).getroot()
    except ElementTree.ParseError as error:
        raise DescriptionError(f"{urdf} is not well-formed XML: {error}") from error


def _prolog(text: str) -> str:
    """Return the text before the root element: the XML declaration and comments."""
    found = PROLOG.match(text)
    return found[0] if found else ""


def _driven(robot: Element) -> Iterator[Element]:
    for joint in robot.findall("joint"):
        mimic = joint.find("mimic")
        if joint.get("type") in MOVING and (mimic is None or mimic.get("mimic") == "false"):
            yield joint


def _limit_endless(joint: Element, reach_rad: float) -> None:
    """Turn a continuous joint into a revolute joint with the range of a position servo."""
    if joint.get("type") != "continuous":
        return
    joint.set("type", "revolute")
    limit = joint.find("limit")
    if limit is None:
        limit = ElementTree.SubElement(joint, "limit", {"velocity": "3", "effort": "3"})
    limit.set("lower", f"{-0.5 * reach_rad:.4f}")
    limit.set("upper", f"{0.5 * reach_rad:.4f}")


def keep_meshes(robot: Element, home: Path, folder: Path) -> None:
    """Rewrite relative mesh paths so that they remain valid from the new folder."""
    for mesh in robot.iter("mesh"):
        name = mesh.get("filename", "")
        if "://" not in name and not os.path.isabs(name) and (home / name).exists():
            mesh.set("filename", os.path.relpath(home / name, folder))


def _block(name: str, joints: list[Element], reach_rad: float) -> Element:
    """Return the <ros2_control> block. The block contains command limits for joints whose range is wider than the
    servo's range."""
    block = Element("ros2_control", {"name": name, "type": "system"})
    hardware = ElementTree.SubElement(block, "hardware")
    ElementTree.SubElement(hardware, "plugin").text = PLUGIN
    ElementTree.SubElement(hardware, "param", {"name": "robot"}).text = ROBOT_FILE
    for joint in joints:
        entry = ElementTree.SubElement(block, "joint", {"name": joint.get("name", "")})
        command = ElementTree.SubElement(entry, "command_interface", {"name": "position"})
        for end, value in _narrowed(joint, reach_rad).items():
            ElementTree.SubElement(command, "param", {"name": end}).text = f"{value:.4f}"
        for state in ("position", "velocity"):
            ElementTree.SubElement(entry, "state_interface", {"name": state})
    ElementTree.indent(block, level=1)
    block.tail = "\n"
    return block


def _narrowed(joint: Element, reach_rad: float) -> Mapping[str, float]:
    """Return the command limits of a joint whose range is wider than its servo's range, or nothing for other joints."""
    limit = joint.find("limit")
    if joint.get("type") != "revolute" or limit is None:
        return {}
    lower, upper = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
    if not (isfinite(lower) and isfinite(upper)) or upper - lower <= reach_rad:
        return {}
    middle = 0.5 * (lower + upper)
    return {"min": middle - 0.5 * reach_rad, "max": middle + 0.5 * reach_rad}
