"""Parse the joints of a URDF, and provide helpers for reading XML attributes."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element

from hal.hal_errors import DescriptionError
from hal.plausible import range_mistake
from hal.robot_description.xml_places import place
from hal.types import JointLimits

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Mimic:
    """Rule by which a joint follows another: position = multiplier * position of the other joint + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint with its pose in the parent link and its limits (rad or m, and per second)."""

    name: str
    kind: str
    parent: str
    child: str
    xyz_m: Vector
    rpy_rad: Vector
    axis: Vector
    lower: float
    upper: float
    velocity: float
    mimic: Mimic | None
    effort: float = math.inf
    """Maximum torque or force, in N m or N; infinite if the URDF does not limit it."""
    place: str = "the URDF"
    """File and line of the joint's <limit>, or of the joint itself if it has no <limit>."""
    commands: tuple[str, ...] = ()
    """Types of the joint's command interfaces: position, velocity, effort."""
    velocity_range: tuple[float, float] | None = None
    """Lowest and highest velocity command, if the <command_interface> of the joint limits velocities."""
    effort_range: tuple[float, float] | None = None
    """Lowest and highest effort command, if the <command_interface> of the joint limits efforts."""
    stops: tuple[float, float] | None = None
    """Ends of the travel from <limit>, if soft limits or a <command_interface> narrow ``lower`` and ``upper``."""

    def limits(self, acceleration: float, jerk: float) -> JointLimits:
        """Return the joint limits, including the acceleration and jerk limits, which a URDF does not contain."""
        return JointLimits(
            *(self.lower, self.upper, self.velocity, acceleration, jerk, self.effort),
            velocity_range=self.velocity_range,
            effort_range=self.effort_range,
        )


def parse_joints(robot: Element) -> dict[str, UrdfJoint]:
    """Parse all joints of a ``<robot>``, keyed by name. Raises DescriptionError."""
    joints: dict[str, UrdfJoint] = {}
    for joint in map(_joint, robot.findall("joint")):
        if joint.name in joints:
            raise DescriptionError(f"the URDF has two joints named '{joint.name}' ({joint.place}): rename one")
        joints[joint.name] = joint
    for joint in joints.values():
        if joint.mimic and joint.mimic.joint not in joints:
            raise DescriptionError(
                f"joint '{joint.name}' mimics '{joint.mimic.joint}', which is not in the URDF ({joint.place}): "
                "correct the name"
            )
    for joint in joints.values():
        _check_led(joint, joints)
    return joints


def _check_led(joint: UrdfJoint, joints: Mapping[str, UrdfJoint]) -> None:
    """Check that the chain of <mimic> ends at a joint that is not a mimic joint. Raises DescriptionError."""
    leader, seen = joint, {joint.name}
    while leader.mimic is not None:
        leader = joints[leader.mimic.joint]
        if leader.name in seen:
            raise DescriptionError(
                f"{joint.name}: the chain of <mimic> elements leads back to {leader.name} ({joint.place}): mimic a "
                "driven joint"
            )
        seen.add(leader.name)


def with_leaders(joints: Mapping[str, UrdfJoint]) -> dict[str, UrdfJoint]:
    """Resolve chains of mimic joints, so that each mimic joint follows a joint that is not a mimic joint."""
    return {name: replace(joint, mimic=_at_the_end(joint, joints)) for name, joint in joints.items()}


def _at_the_end(joint: UrdfJoint, joints: Mapping[str, UrdfJoint]) -> Mimic | None:
    mimic = joint.mimic
    while mimic is not None and (above := joints[mimic.joint].mimic) is not None:
        offset = mimic.multiplier * above.offset + mimic.offset
        mimic = Mimic(above.joint, mimic.multiplier * above.multiplier, offset)
    return mimic


def _joint(element: Element) -> UrdfJoint:
    name = attribute(element, "name", "a joint")
    kind = attribute(element, "type", f"joint '{name}'")
    limit = element.find("limit")
    endless = kind == "continuous"
    if limit is None and kind in ("revolute", "prismatic"):
        raise DescriptionError(
            f"joint '{name}' is {kind} but has no <limit> ({place(element)}): "
            "add a <limit> with lower, upper and velocity"
        )
    bounds = limit if limit is not None else Element("limit")
    origin = element.find("origin")
    pose = origin if origin is not None else Element("origin")
    mimic = element.find("mimic")
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=_child(element, "parent", name),
        child=_child(element, "child", name),
        xyz_m=vector(pose, "xyz", f"joint '{name}'", "distance"),
        rpy_rad=vector(pose, "rpy", f"joint '{name}'", "angle"),
        axis=_axis(element, name),
        lower=-math.inf if endless else number(bounds, "lower", name, 0.0),
        upper=math.inf if endless else number(bounds, "upper", name, 0.0),
        velocity=number(bounds, "velocity", name, 0.0),
        mimic=None if mimic is None else _mimic(mimic, name),
        effort=number(bounds, "effort", name, math.inf),
        place=place(element if limit is None else limit),
    )


def _mimic(element: Element, name: str) -> Mimic:
    return Mimic(
        attribute(element, "joint", f"<mimic> of joint '{name}'"),
        number(element, "multiplier", name, 1.0, "multiplier"),
        number(element, "offset", name, 0.0, "position"),
    )


def _child(element: Element, tag: str, name: str) -> str:
    child = element.find(tag)
    if child is None:
        raise DescriptionError(f"joint '{name}' has no <{tag}> ({place(element)}): add the element")
    return attribute(child, "link", f"<{tag}> of joint '{name}'")


def _axis(element: Element, name: str) -> Vector:
    axis = element.find("axis")
    if axis is None:
        return 1.0, 0.0, 0.0
    direction = vector(axis, "xyz", f"joint '{name}'", "distance", "1 0 0")
    if not any(direction):
        raise DescriptionError(f"joint '{name}': the <axis> is zero ({place(axis)}): write a direction, such as 0 0 1")
    if mistake := range_mistake("axis_length", math.hypot(*direction)):
        raise DescriptionError(f"joint '{name}': the length of <axis> {mistake} ({place(axis)})")
    return direction


def attribute(element: Element, key: str, owner: str) -> str:
    """Return a required attribute. Raises DescriptionError.

    Args:
        element: The element.
        key: Name of the attribute.
        owner: Description of the element, used in the message.
    """
    value = element.get(key)
    if not value:
        raise DescriptionError(f"{owner} of the URDF has no {key} ({place(element)}): add the attribute")
    return value


def number(element: Element, key: str, name: str, default: float, kind: str = "") -> float:
    """Return a numeric attribute of a joint. Raises DescriptionError if the number is not finite or not plausible for
    its type.

    Args:
        element: The element.
        key: Name of the attribute.
        name: Name of the joint, used in the message.
        default: Value to use if the attribute is missing.
        kind: Type of number in ``hal.plausible.RANGES``; empty if the number is not checked.
    """
    text = element.get(key)
    try:
        value = default if text is None else finite(text)
    except ValueError as error:
        raise DescriptionError(f"joint '{name}': {key} must be a number, not '{text}' ({place(element)})") from error
    if kind and (mistake := range_mistake(kind, value)):
        raise DescriptionError(f"joint '{name}': {key} {mistake} ({place(element)})")
    return value


def vector(element: Element, key: str, owner: str, kind: str, default: str = "0 0 0") -> Vector:
    """Return the three numbers in an attribute. Raises DescriptionError for implausible numbers.

    Args:
        element: The element.
        key: Name of the attribute.
        owner: Description of the element, for the message.
        kind: Type of number in ``hal.plausible.RANGES``.
        default: Value if the attribute is missing.
    """
    text = element.get(key, default)
    try:
        x, y, z = (finite(part) for part in text.split())
    except ValueError as error:
        raise DescriptionError(f"{owner}: {key} must be three numbers, not '{text}' ({place(element)})") from error
    for value in (x, y, z):
        if mistake := range_mistake(kind, value):
            raise DescriptionError(f"{owner}: {key} {mistake} ({place(element)})")
    return x, y, z


def finite(text: str) -> float:
    """Convert a string to a finite number. NaN also raises ValueError, because a NaN limit would have no effect."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def doubles(names: Iterable[str]) -> list[str]:
    """Return every repeated occurrence of a name."""
    seen: set[str] = set()
    return [name for name in names if name in seen or seen.add(name)]  # type: ignore[func-returns-value]
