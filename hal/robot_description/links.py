"""Parse the links of a URDF with their masses and inertias."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element

from hal.hal_errors import DescriptionError
from hal.plausible import range_mistake
from hal.robot_description.urdf import UrdfJoint, Vector, attribute, finite, vector
from hal.robot_description.xml_places import place

AXES: Final = ("ixx", "iyy", "izz")
PRODUCTS: Final = ("ixy", "ixz", "iyz")


@dataclass(frozen=True, slots=True)
class Link:
    """A link. Mass and inertia are zero if the URDF does not specify them."""

    name: str
    mass_kg: float
    center_m: Vector
    """Center of mass in the link frame, in m."""
    inertia: Vector
    """Moments of inertia about the x, y and z axes, in kg m²."""


def parse_links(robot: Element) -> dict[str, Link]:
    """Parse all links of a ``<robot>``, keyed by name. Raises DescriptionError."""
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
        _number(name, inertia, product, (product, "product_of_inertia"))
    ixx, iyy, izz = (_not_negative(name, inertia, axis, (axis, "inertia")) for axis in AXES)
    return Link(
        name,
        _not_negative(name, element.find("inertial/mass"), "value", ("mass", "mass")),
        vector(Element("origin") if origin is None else origin, "xyz", f"link '{name}'", "distance"),
        (ixx, iyy, izz),
    )


def _not_negative(link: str, element: Element | None, key: str, what: tuple[str, str]) -> float:
    value = _number(link, element, key, what)
    if element is not None and value < 0.0:
        raise DescriptionError(f"link '{link}': {what[0]} must be at least 0, not {value:g} ({place(element)})")
    return value


def _number(link: str, element: Element | None, key: str, what: tuple[str, str]) -> float:
    """Parse a number that belongs to a link; return 0 if it is missing.

    ``what`` contains the name of the number in messages and the type of number in ``RANGES``.
    """
    if element is None:
        return 0.0
    (name, kind), text = what, element.get(key, "0")
    try:
        value = finite(text)
    except ValueError as error:
        raise DescriptionError(f"link '{link}': {name} must be a number, not '{text}' ({place(element)})") from error
    if (value >= 0.0 or kind == "product_of_inertia") and (mistake := range_mistake(kind, value)):
        raise DescriptionError(f"link '{link}': {name} {mistake} ({place(element)})")
    return value


def link_problems(joints: Mapping[str, UrdfJoint], links: Mapping[str, Link]) -> Iterator[str]:
    """Yield a message for each missing link, for each link with two parent joints, and for each loop of links.

    A URDF without any links is valid.
    """
    movers: dict[str, str] = {}
    for joint in joints.values() if links else ():
        for link in (joint.parent, joint.child):
            if link not in links:
                yield f"{joint.name}: link {link} is not in the URDF ({joint.place}): correct its name, or add the link"
        other = movers.setdefault(joint.child, joint.name)
        if other != joint.name:
            yield f"{other} and {joint.name} have the same child link, {joint.child} ({joint.place}): rename one"
    above = {joint.child: joint for joint in joints.values()}
    if len(above) == len(joints) and (loop := [joint for joint in joints.values() if _is_in_loop(joint, above)]):
        last = loop[-1]
        yield (
            f"{last.name}: its child link {last.child} is an ancestor of its parent link {last.parent}, so the links "
            f"form a loop ({last.place}): correct one of the two links"
        )


def _is_in_loop(joint: UrdfJoint, above: Mapping[str, UrdfJoint]) -> bool:
    seen: set[str] = set()
    link = joint.parent
    while link != joint.child and link in above and link not in seen:
        seen.add(link)
        link = above[link].parent
    return link == joint.child
