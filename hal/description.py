"""The robot description: what a URDF says about joints and about ros2_control's hardware."""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from hal.errors import DescriptionError

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


@dataclass(frozen=True, slots=True)
class Component:
    """One ``<ros2_control>`` block: the plugin, its parameters, and interfaces of each joint."""

    name: str
    kind: str
    plugin: str
    parameters: Mapping[str, str]
    command_interfaces: Mapping[str, tuple[str, ...]]
    state_interfaces: Mapping[str, tuple[str, ...]]

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that take commands, in the file's order."""
        return tuple(name for name, interfaces in self.command_interfaces.items() if interfaces)


@dataclass(frozen=True, slots=True)
class Description:
    """A parsed URDF."""

    xml: str
    joints: Mapping[str, UrdfJoint]
    components: tuple[Component, ...] = field(default=())


def parse_urdf(xml: str) -> Description:
    """Parse a URDF with at least one ``<ros2_control>`` block. Raises DescriptionError."""
    try:
        robot = ElementTree.fromstring(xml)
    except ElementTree.ParseError as error:
        raise DescriptionError(f"the URDF is not well-formed XML: {error}") from error
    if robot.tag != "robot":
        raise DescriptionError(f"the URDF's root is <{robot.tag}>, not <robot>")
    joints = _joints(robot)
    components = tuple(_component(block, joints) for block in robot.findall("ros2_control"))
    if not components:
        raise DescriptionError(
            "the URDF has no <ros2_control> block: add one with <hardware><plugin>"
            "servoloop/ServoHardware</plugin></hardware> and a <joint> for each driven joint"
        )
    return Description(xml, joints, components)


def _joints(robot: Element) -> dict[str, UrdfJoint]:
    joints: dict[str, UrdfJoint] = {}
    for joint in map(_joint, robot.findall("joint")):
        if joint.name in joints:
            raise DescriptionError(f"the URDF has two joints named '{joint.name}'")
        joints[joint.name] = joint
    for joint in joints.values():
        if joint.mimic and joint.mimic.joint not in joints:
            raise DescriptionError(f"joint '{joint.name}' mimics '{joint.mimic.joint}', which the URDF has not")
    return joints


def _joint(element: Element) -> UrdfJoint:
    name = _attribute(element, "name", "a joint")
    kind = _attribute(element, "type", f"joint '{name}'")
    limit = element.find("limit")
    if limit is None and kind in ("revolute", "prismatic"):
        raise DescriptionError(f"joint '{name}' is {kind} and has no <limit>")
    bounds = limit if limit is not None else Element("limit")
    origin = element.find("origin")
    place = origin if origin is not None else Element("origin")
    mimic = element.find("mimic")
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=_child(element, "parent", name),
        child=_child(element, "child", name),
        xyz_m=_vector(place.get("xyz", "0 0 0"), name),
        rpy_rad=_vector(place.get("rpy", "0 0 0"), name),
        axis=_axis(element, name),
        lower=_number(bounds, "lower", name, 0.0),
        upper=_number(bounds, "upper", name, 0.0),
        velocity=_number(bounds, "velocity", name, 0.0),
        mimic=None if mimic is None else _mimic(mimic, name),
    )


def _mimic(element: Element, name: str) -> Mimic:
    return Mimic(
        _attribute(element, "joint", f"<mimic> of joint '{name}'"),
        _number(element, "multiplier", name, 1.0),
        _number(element, "offset", name, 0.0),
    )


def _component(block: Element, joints: Mapping[str, UrdfJoint]) -> Component:
    name = _attribute(block, "name", "a <ros2_control> block")
    hardware = block.find("hardware")
    plugin = "" if hardware is None else hardware.findtext("plugin", "").strip()
    if hardware is None or not plugin:
        raise DescriptionError(f"<ros2_control name='{name}'> has no <hardware><plugin>")
    elements = {_attribute(e, "name", f"a joint of '{name}'"): e for e in block.findall("joint")}
    for joint in elements:
        if joint not in joints:
            raise DescriptionError(f"<ros2_control name='{name}'> names joint '{joint}', which the URDF has not")
    return Component(
        name=name,
        kind=_attribute(block, "type", f"<ros2_control name='{name}'>"),
        plugin=plugin,
        parameters={_attribute(p, "name", "a <param>"): (p.text or "").strip() for p in hardware.findall("param")},
        command_interfaces={j: _interfaces(e, "command_interface") for j, e in elements.items()},
        state_interfaces={j: _interfaces(e, "state_interface") for j, e in elements.items()},
    )


def _interfaces(element: Element, tag: str) -> tuple[str, ...]:
    return tuple(_attribute(e, "name", f"a <{tag}>") for e in element.findall(tag))


def _attribute(element: Element, key: str, where: str) -> str:
    value = element.get(key)
    if not value:
        raise DescriptionError(f"{where} of the URDF has no {key}")
    return value


def _child(element: Element, tag: str, name: str) -> str:
    child = element.find(tag)
    if child is None:
        raise DescriptionError(f"joint '{name}' has no <{tag}>")
    return _attribute(child, "link", f"<{tag}> of joint '{name}'")


def _axis(element: Element, name: str) -> Vector:
    axis = element.find("axis")
    direction = _vector("1 0 0" if axis is None else axis.get("xyz", "1 0 0"), name)
    if not any(direction):
        raise DescriptionError(f"joint '{name}': the <axis> has no direction")
    return direction


def _number(element: Element, key: str, name: str, default: float) -> float:
    text = element.get(key)
    try:
        return default if text is None else _finite(text)
    except ValueError as error:
        raise DescriptionError(f"joint '{name}': {key} '{text}' is not a number") from error


def _vector(text: str, name: str) -> Vector:
    try:
        x, y, z = (_finite(part) for part in text.split())
    except ValueError as error:
        raise DescriptionError(f"joint '{name}': '{text}' is not three numbers") from error
    return x, y, z


def _finite(text: str) -> float:
    """NaN compares with nothing: a limit of NaN would be no limit."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value
