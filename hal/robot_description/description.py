"""Parse a URDF into joints, links and hardware components."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final
from xml.parsers.expat import ExpatError

from hal.hal_errors import DescriptionError
from hal.robot_description.command_ranges import narrowed, range_problems, range_warnings
from hal.robot_description.hardware_info import HardwareInfo, merged, parse_hardware_info, without_refused_mimics
from hal.robot_description.limit_check import limit_problems, with_wheel_speeds
from hal.robot_description.links import Link, link_problems, parse_links
from hal.robot_description.node_names import LONGEST_NAME, STACK_NODES
from hal.robot_description.soft_limits import (
    SoftLimits,
    parse_soft_limits,
    soft_limit_problems,
    soft_limit_warnings,
    softened,
)
from hal.robot_description.urdf import Mimic, UrdfJoint, Vector, doubles, parse_joints, with_leaders
from hal.robot_description.xml_places import is_xacro, number_problems, parse_xml, place

__all__ = ["Description", "HardwareInfo", "Link", "Mimic", "UrdfJoint", "Vector", "merged", "parse_urdf"]

XACRO: Final = "this file is xacro, not URDF: run 'xacro FILE > robot.urdf' and use robot.urdf instead"


@dataclass(frozen=True, slots=True)
class Description:
    """A parsed URDF."""

    xml: str
    joints: Mapping[str, UrdfJoint]
    """Joints, keyed by name. Soft limits and the ranges of command interfaces have already been applied to their
    limits."""
    components: tuple[HardwareInfo, ...] = field(default=())
    links: Mapping[str, Link] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    """Descriptions of values that have no effect."""


def parse_urdf(xml: str, file: str = "the URDF") -> Description:
    """Parse and check a URDF with at least one ``<ros2_control>`` block.

    Args:
        xml: The URDF as a string.
        file: File name to use in messages.

    Raises:
        DescriptionError: The URDF is invalid.
    """
    try:
        robot = parse_xml(xml, file)
    except ExpatError as error:
        if "<xacro:" in xml:
            raise DescriptionError(f"{file}, line {error.lineno}: {XACRO}") from error
        raise DescriptionError(f"the URDF is not well-formed XML: {error}") from error
    if robot.tag != "robot":
        raise DescriptionError(f"the URDF's root is <{robot.tag}>, not <robot> ({place(robot)}): correct the root tag")
    if is_xacro(robot):
        raise DescriptionError(f"{place(robot)}: {XACRO}")
    blocks, links = robot.findall("ros2_control"), parse_links(robot)
    joints = with_leaders(without_refused_mimics(blocks, parse_joints(robot)))
    components = tuple(parse_hardware_info(block, joints) for block in blocks)
    _check_apart(components, joints, {block.get("name", ""): place(block) for block in blocks})
    if not components:
        raise DescriptionError(
            "the URDF has no <ros2_control> block: add a block with <hardware><plugin>"
            "servoloop/ServoHardware</plugin></hardware> and a <joint> for each driven joint"
        )
    whole = merged(components)
    joints = {n: replace(joint, commands=whole.command_interfaces.get(n, ())) for n, joint in joints.items()}
    joints, wheels = with_wheel_speeds(joints)
    if problems := [*link_problems(joints, links), *limit_problems(joints), *number_problems(robot)]:
        raise DescriptionError("\n".join(problems))
    softened_joints, warnings = _softened(joints, parse_soft_limits(robot))
    limited, more = _narrowed(softened_joints, whole)
    return Description(xml, limited, components, links, (*wheels, *warnings, *more))


def _softened(
    joints: Mapping[str, UrdfJoint], soft: Mapping[str, SoftLimits]
) -> tuple[dict[str, UrdfJoint], tuple[str, ...]]:
    """Narrow the joint limits to the soft limits. Return the joints and warnings. Raises DescriptionError."""
    own = [(joint, soft[name]) for name, joint in joints.items() if name in soft]
    if problems := [problem for joint, limits in own for problem in soft_limit_problems(joint, limits)]:
        raise DescriptionError("\n".join(problems))
    warnings = tuple(warning for joint, limits in own for warning in soft_limit_warnings(joint, limits))
    return {**joints, **{joint.name: softened(joint, limits) for joint, limits in own}}, warnings


def _narrowed(joints: Mapping[str, UrdfJoint], whole: HardwareInfo) -> tuple[dict[str, UrdfJoint], tuple[str, ...]]:
    """Narrow the joint limits to the ranges of the joints' commands. Return the joints and warnings.

    Raises:
        DescriptionError: A range leaves a joint no room to move.
    """
    problems: list[str] = []
    warnings: list[str] = []
    limited = dict(joints)
    for name, joint in joints.items():
        interfaces = {kind: f"{name}/{kind}" for kind in joint.commands}
        ranges = {kind: whole.command_ranges[i] for kind, i in interfaces.items() if i in whole.command_ranges}
        problems += range_problems(joint, ranges)
        warnings += range_warnings(joint, ranges)
        if ranges and not problems:
            limited[name] = replace(narrowed(joint, ranges), stops=joint.stops or (joint.lower, joint.upper))
    if problems:
        raise DescriptionError("\n".join(problems))
    return limited, tuple(warnings)


def _check_apart(
    components: Sequence[HardwareInfo], joints: Mapping[str, UrdfJoint], places: Mapping[str, str]
) -> None:
    """Check that block names are unique, that each joint is in only one block, and that the leaders of mimic joints are
    measured.

    Args:
        components: The blocks.
        joints: Joints, keyed by name.
        places: File and line of each block, keyed by name.

    Raises:
        DescriptionError: A check failed.
    """
    if twice := doubles(component.name for component in components):
        raise DescriptionError(f"two <ros2_control> blocks are named '{twice[0]}' ({places[twice[0]]}): rename one")
    _check_node_names(components, places)
    owners = [(joint, component.name) for component in components for joint in component.command_interfaces]
    if twice := doubles(name for component in components for name in component.sensors):
        raise DescriptionError(f"two blocks have a <sensor> or <gpio> named '{twice[0]}': rename one")
    if twice := doubles(joint for joint, _ in owners):
        last = dict(owners)[twice[0]]
        raise DescriptionError(
            f"joint '{twice[0]}' is in two <ros2_control> blocks ({places[last]}): remove it from one"
        )
    measured = {joint for component in components for joint in component.joints}
    for joint in (joint for component in components for joint in sorted(component.mimics)):
        mimic = joints[joint].mimic
        if mimic is not None and mimic.joint not in measured:
            raise DescriptionError(
                f"joint '{joint}' mimics '{mimic.joint}', which is not in a <ros2_control> block "
                f"({joints[joint].place}): add {mimic.joint} to a block"
            )


def _check_node_names(components: Sequence[HardwareInfo], places: Mapping[str, str]) -> None:
    """Check that the ROS nodes of the blocks can be created, and that their names differ from each other and from those
    of the stack's own nodes. The arguments are those of ``_check_apart``."""
    owners: dict[str, str] = {}
    for component in components:
        name = component.name
        if len(name) > LONGEST_NAME:
            text = f"has a name of {len(name)} characters: shorten it to at most {LONGEST_NAME}"
            raise DescriptionError(f"a <ros2_control> block ({places[name]}) {text}")
        block, (node,) = f"<ros2_control name='{name}'> ({places[name]})", component.node_names
        if node in STACK_NODES:
            raise DescriptionError(f"{block} has the name of the stack's own node {node}: rename the block")
        if node in owners:
            raise DescriptionError(f"{block} has the node name {node}, as has '{owners[node]}': rename one block")
        owners[node] = name
