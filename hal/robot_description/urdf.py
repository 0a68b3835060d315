"""The joints of a URDF, and what reading XML takes."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element

from hal.errors import DescriptionError
from hal.plausible import range_mistake
from hal.robot_description.xml_places import place
from hal.types import JointLimits

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Mimic:
    """A joint that follows another: position = multiplier * other + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """One joint: its place in the parent link (m, rad) and its limits (rad or m, and per second)."""

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
    """N m or N; not said: no limit."""
    place: str = "the URDF"
    """The file and the line of its <limit>, or of the joint if it has none."""
    commands: tuple[str, ...] = ()
    """The kinds of its command interfaces: position, velocity, effort."""
    velocity_range: tuple[float, float] | None = None
    """Lowest and highest velocity command, if its <command_interface> limits them."""
    effort_range: tuple[float, float] | None = None
    """Lowest and highest effort command, likewise."""
    stops: tuple[float, float] | None = None
    """Where the travel ends by <limit>, if a <command_interface> has narrowed ``lower`` and ``upper``."""

    def limits(self, acceleration: float, jerk: float) -> JointLimits:
        """The joint's limits, with those that a URDF does not give."""
        return JointLimits(
            *(self.lower, self.upper, self.velocity, acceleration, jerk, self.effort),
            velocity_range=self.velocity_range,
            effort_range=self.effort_range,
        )


def parse_joints(robot: Element) -> dict[str, UrdfJoint]:
    """Parse all joints of a ``<robot>``, by name. Raises DescriptionError."""
    joints: dict[str, UrdfJoint] = {}
    for joint in map(_joint, robot.findall("joint")):
        if joint.name in joints:
            raise DescriptionError(f"the URDF has two joints named '{joint.name}' ({joint.place}): rename one")
        joints[joint.name] = joint
    for joint in joints.values():
        if joint.mimic and joint.mimic.joint not in joints:
            raise DescriptionError(
                f"joint '{joint.name}' mimics '{joint.mimic.joint}', which the URDF has not ({joint.place}): correct it"
            )
    for joint in joints.values():
        _check_led(joint, joints)
    return joints


def _check_led(joint: UrdfJoint, joints: Mapping[str, UrdfJoint]) -> None:
    """Check that the <mimic> of a joint ends at a joint that mimics no other. Raises DescriptionError."""
    leader, seen = joint, {joint.name}
    while leader.mimic is not None:
        leader = joints[leader.mimic.joint]
        if leader.name in seen:
            raise DescriptionError(
                f"{joint.name}: its <mimic> leads back to {leader.name} ({joint.place}): name a joint that is driven."
            )
        seen.add(leader.name)


def with_leaders(joints: Mapping[str, UrdfJoint]) -> dict[str, UrdfJoint]:
    """Let each joint that mimics a mimic follow the joint at the end of the chain, which mimics no other."""
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
            f"joint '{name}' is {kind} and has no <limit> ({place(element)}): add one with lower, upper and velocity"
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
        raise DescriptionError(f"joint '{name}' has no <{tag}> ({place(element)}): add it")
    return attribute(child, "link", f"<{tag}> of joint '{name}'")


def _axis(element: Element, name: str) -> Vector:
    axis = element.find("axis")
    if axis is None:
        return 1.0, 0.0, 0.0
    direction = vector(axis, "xyz", f"joint '{name}'", "distance", "1 0 0")
    if not any(direction):
        raise DescriptionError(f"joint '{name}': the <axis> has no direction ({place(axis)}): give it one")
    if mistake := range_mistake("axis_length", math.hypot(*direction)):
        raise DescriptionError(f"joint '{name}': the length of <axis> {mistake} ({place(axis)})")
    return direction


def attribute(element: Element, key: str, where: str) -> str:
    """An attribute that must be there. Raises DescriptionError, in which ``where`` says whose it is."""
    value = element.get(key)
    if not value:
        raise DescriptionError(f"{where} of the URDF has no {key} ({place(element)}): add it")
    return value


def number(element: Element, key: str, name: str, default: float, kind: str = "") -> float:
    """A finite number of joint ``name``, of a plausible ``kind`` if that is given. Raises DescriptionError."""
    text = element.get(key)
    try:
        value = default if text is None else finite(text)
    except ValueError as error:
        raise DescriptionError(
            f"joint '{name}': {key} '{text}' is not a number ({place(element)}): correct it"
        ) from error
    if kind and (mistake := range_mistake(kind, value)):
        raise DescriptionError(f"joint '{name}': {key} {mistake} ({place(element)})")
    return value


def vector(element: Element, key: str, owner: str, kind: str, default: str = "0 0 0") -> Vector:
    """Three plausible numbers of one ``kind``; ``owner`` has the element. Raises DescriptionError."""
    text = element.get(key, default)
    try:
        x, y, z = (finite(part) for part in text.split())
    except ValueError as error:
        raise DescriptionError(f"{owner}: '{text}' is not three numbers ({place(element)}): correct {key}") from error
    for value in (x, y, z):
        if mistake := range_mistake(kind, value):
            raise DescriptionError(f"{owner}: {key} {mistake} ({place(element)})")
    return x, y, z


def finite(text: str) -> float:
    """Raises ValueError where it is no number. NaN compares with nothing: a limit of NaN would be no limit."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def doubles(names: Iterable[str]) -> list[str]:
    """Names that were there before."""
    seen: set[str] = set()
    return [name for name in names if name in seen or seen.add(name)]  # type: ignore[func-returns-value]
