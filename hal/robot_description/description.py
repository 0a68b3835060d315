"""The robot description: what a URDF says about joints and about ros2_control's hardware."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hal.errors import DescriptionError
from hal.robot_description.hardware_info import HardwareInfo, merged, parse_hardware_info
from hal.robot_description.urdf import Mimic, UrdfJoint, Vector, doubles, parse_joints

__all__ = ["Description", "HardwareInfo", "Mimic", "UrdfJoint", "Vector", "merged", "parse_urdf"]


@dataclass(frozen=True, slots=True)
class Description:
    """A parsed URDF."""

    xml: str
    joints: Mapping[str, UrdfJoint]
    components: tuple[HardwareInfo, ...] = field(default=())


def parse_urdf(xml: str) -> Description:
    """Parse a URDF with at least one ``<ros2_control>`` block. Raises DescriptionError."""
    try:
        robot = ElementTree.fromstring(xml)
    except ElementTree.ParseError as error:
        raise DescriptionError(f"the URDF is not well-formed XML: {error}") from error
    if robot.tag != "robot":
        raise DescriptionError(f"the URDF's root is <{robot.tag}>, not <robot>")
    joints = parse_joints(robot)
    components = tuple(parse_hardware_info(block, joints) for block in robot.findall("ros2_control"))
    _check_apart(components, joints)
    if not components:
        raise DescriptionError(
            "the URDF has no <ros2_control> block: add one with <hardware><plugin>"
            "servoloop/ServoHardware</plugin></hardware> and a <joint> for each driven joint"
        )
    return Description(xml, joints, components)


def _check_apart(components: Sequence[HardwareInfo], joints: Mapping[str, UrdfJoint]) -> None:
    """Check that every block has a name of its own, and every joint one block.

    A mimic joint is measured where its leader is.
    """
    if twice := doubles(component.name for component in components):
        raise DescriptionError(f"two <ros2_control> blocks are called '{twice[0]}': each needs a name of its own")
    if twice := doubles(joint for component in components for joint in component.command_interfaces):
        raise DescriptionError(f"joint '{twice[0]}' is in two <ros2_control> blocks: a joint belongs to one")
    measured = {joint for component in components for joint in component.joints}
    for joint in (joint for component in components for joint in sorted(component.mimics)):
        mimic = joints[joint].mimic
        if mimic is not None and mimic.joint not in measured:
            raise DescriptionError(f"joint '{joint}' mimics '{mimic.joint}', which no <ros2_control> block drives")
