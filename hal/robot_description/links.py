"""The links of a URDF: their masses and inertias."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element

from hal.errors import DescriptionError
from hal.robot_description.urdf import UrdfJoint, Vector, attribute, finite, vector
from hal.robot_description.xml_places import place

AXES: Final = ("ixx", "iyy", "izz")
PRODUCTS: Final = ("ixy", "ixz", "iyz")


@dataclass(frozen=True, slots=True)
class Link:
    """One link: its mass (kg), its center of mass in the link's frame (m) and its moments of inertia (kg m²)."""

    name: str
    mass_kg: float
    center_m: Vector
    inertia: Vector
    """About the axes x, y and z. Zero, like the mass, if the URDF does not give it."""


def parse_links(robot: Element) -> dict[str, Link]:
    """Parse all links of a ``<robot>``, by name. Raises DescriptionError."""
    links: dict[str, Link] = {}
    for element in robot.findall("link"):
        link = _link(element)
        if link.name in links:
            raise DescriptionError(f"the URDF has two links named '{link.name}' ({place(element)}): rename one")
        links[link.name] = link
    return links


def _link(element: Element) -> Link:
    name = attribute(element, "name", "a link")
    origin, inertia = element.find("inertial/origin"), element.find("inertial/inertia")
    for product in PRODUCTS:
        _number(name, inertia, product, product)
    ixx, iyy, izz = (_not_negative(name, inertia, axis, axis) for axis in AXES)
    return Link(
        name,
        _not_negative(name, element.find("inertial/mass"), "value", "mass"),
        vector("0 0 0" if origin is None else origin.get("xyz", "0 0 0"), name),
        (ixx, iyy, izz),
    )


def _not_negative(link: str, element: Element | None, key: str, what: str) -> float:
    value = _number(link, element, key, what)
    if element is not None and value < 0.0:
        raise DescriptionError(f"link '{link}': {what} {value:g} is below zero ({place(element)}): correct it")
    return value


def _number(link: str, element: Element | None, key: str, what: str) -> float:
    text = "0" if element is None else element.get(key, "0")
    try:
        return finite(text)
    except ValueError as error:
        where = "" if element is None else f" ({place(element)})"
        raise DescriptionError(f"link '{link}': {what} '{text}' is not a number{where}: correct it") from error


def link_problems(joints: Mapping[str, UrdfJoint], links: Mapping[str, Link]) -> Iterator[str]:
    """Yields joints between links that are missing, and links that two joints move. A URDF may have no links."""
    movers: dict[str, str] = {}
    for joint in joints.values() if links else ():
        for link in (joint.parent, joint.child):
            if link not in links:
                yield f"{joint.name}: the URDF has no link {link} ({joint.place}): correct its name, or add the link"
        other = movers.setdefault(joint.child, joint.name)
        if other != joint.name:
            yield f"{other} and {joint.name} have the same child link, {joint.child} ({joint.place}): rename one"
