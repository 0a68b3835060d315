"""Read groups, end effectors and named states from MoveIt's SRDF files."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element
from xml.parsers.expat import ExpatError

from hal.robot_description.description import Description
from hal.robot_description.xml_places import is_xacro, parse_xml, place
from hal.text_file import read_xml
from planning.arm_model import Pair, pair
from planning.groups import EndEffector, Group, Groups, outside, path_to
from planning.planning_errors import PlanningError

OWN_POSITION: Final = ("revolute", "continuous", "prismatic")
"""Joint types with independent positions."""


class SrdfError(PlanningError):
    """An SRDF file contains errors. The message lists all errors with their line numbers."""

    def __init__(self, message: str) -> None:
        super().__init__("INVALID_ROBOT_STATE", message)


def read_srdf(path: Path, description: Description) -> Groups:
    """Read an SRDF file. Raises SrdfError if the file contains errors.

    Args:
        path: The file.
        description: Description of the same robot.
    """
    return parse_srdf(read_xml(path, SrdfError), description, str(path))


def parse_srdf(xml: str, description: Description, file: str = "the SRDF") -> Groups:
    """Parse an SRDF. Virtual joints and disabled collisions are ignored.

    Args:
        xml: The SRDF as a string.
        description: Description of the same robot.
        file: Name of the file, for messages.

    Raises:
        SrdfError: The file contains errors.
    """
    return _Reader(_root(xml, file), description).groups()


def _root(xml: str, file: str) -> Element:
    try:
        robot = parse_xml(xml, file)
    except ExpatError as error:
        raise SrdfError(f"{file} is not well-formed XML: {error}") from error
    if robot.tag != "robot":
        raise SrdfError(f"the root of an SRDF is <robot>, not <{robot.tag}> ({place(robot)}): correct the root tag")
    if is_xacro(robot):
        raise SrdfError(
            f"{place(robot)}: this file is xacro, not SRDF: run 'xacro FILE > robot.srdf' and use its output"
        )
    return robot


def read_pairs(path: Path) -> dict[Pair, str]:
    """Read the pairs of links that an SRDF file excludes from collision checks. Raises SrdfError if the file contains
    errors."""
    return parse_pairs(read_xml(path, SrdfError), str(path))


def parse_pairs(xml: str, file: str = "the SRDF") -> dict[Pair, str]:
    """Parse the ``<disable_collisions>`` elements of an SRDF.

    Args:
        xml: The SRDF as text.
        file: Name of the file, for messages.

    Returns:
        The reason for excluding each pair of links, such as "Adjacent" or "Never". The reason is empty if the element
        does not contain one.

    Raises:
        SrdfError: The string is not valid XML, or an element names fewer than two links.
    """
    found: dict[Pair, str] = {}
    for element in _root(xml, file).iter("disable_collisions"):
        one, other = element.get("link1"), element.get("link2")
        if not one or not other:
            raise SrdfError(f"{place(element)}: a <disable_collisions> needs link1 and link2: add both")
        found[pair(one, other)] = element.get("reason", "")
    return found


class _Reader:
    """Reader for one document, which collects all errors."""

    def __init__(self, robot: Element, description: Description) -> None:
        self._robot = robot
        self._description = description
        self._problems: list[str] = []
        self._passive = {element.get("name", "") for element in robot.findall("passive_joint")}

    def groups(self) -> Groups:
        elements = self._named("group")
        if not elements:
            self._problems.append(
                f"the SRDF has no <group> ({place(self._robot)}): add a <group> with the joints of the arm"
            )
        groups = {name: self._group(name, elements) for name in elements}
        groups = self._with_states(groups)
        effectors = self._end_effectors(groups)
        for effector in effectors.values():
            arm = groups.get(effector.parent_group)
            if arm is not None and arm.tip is None:
                groups[arm.name] = replace(arm, tip=effector.parent_link)
        if self._problems:
            raise SrdfError("\n".join(self._problems))
        return Groups(groups, effectors)

    def _named(self, tag: str) -> dict[str, Element]:
        """Return the elements with the given tag, keyed by name."""
        found: dict[str, Element] = {}
        for element in self._robot.findall(tag):
            name = element.get("name", "")
            if not name:
                self._problem(element, f"a <{tag}> has no name: add a name")
            elif name in found:
                self._problem(element, f"there are two <{tag}> named {name}: rename one")
            else:
                found[name] = element
        return found

    def _problem(self, element: Element, text: str) -> None:
        self._problems.append(f"{place(element)}: {text}")

    def _group(self, name: str, elements: Mapping[str, Element]) -> Group:
        names = list(dict.fromkeys(self._members(name, elements, ())))
        joints = tuple(joint for joint in names if self._has_own_position(joint))
        chains = elements[name].findall("chain")
        if not joints and not self._problems:
            self._problem(elements[name], f"group {name} has no joint that moves: add a <joint> or a <chain>")
        return Group(name, joints, chains[0].get("tip_link") if len(chains) == 1 else None)

    def _has_own_position(self, name: str) -> bool:
        joint = self._description.joints[name]
        return joint.kind in OWN_POSITION and joint.mimic is None and name not in self._passive

    def _members(self, name: str, elements: Mapping[str, Element], inside: tuple[str, ...]) -> Iterator[str]:
        """Yield the joints of a group and of its subgroups. ``inside`` contains the groups that contain this group."""
        if name in inside:
            self._problem(elements[name], f"group {name} contains itself: remove it from {inside[-1]}")
            return
        for element in elements[name]:
            if element.tag == "chain":
                yield from self._chain(element)
            elif element.tag in ("joint", "link", "group"):
                yield from self._member(element, elements, (*inside, name))
            else:
                self._problem(element, f"group {name} has an unknown tag <{element.tag}>: remove it")

    def _member(self, element: Element, elements: Mapping[str, Element], inside: tuple[str, ...]) -> Iterator[str]:
        name, joints = element.get("name", ""), self._description.joints
        if element.tag == "group" and name in elements:
            yield from self._members(name, elements, inside)
        elif element.tag == "joint" and name in joints:
            yield name
        elif element.tag == "link" and name in self._description.links:
            yield from (joint.name for joint in joints.values() if joint.child == name)
        else:
            known = {"group": elements, "joint": joints, "link": self._description.links}[element.tag]
            self._unknown(element, element.tag, name, known)

    def _unknown(self, element: Element, kind: str, name: str, known: Mapping[str, object]) -> None:
        what = f"there is no {kind} {name}" if name else f"<{element.tag}> does not specify a {kind}"
        self._problem(element, f"{what}: choose one of {', '.join(known)}")

    def _chain(self, element: Element) -> Iterator[str]:
        base, tip = element.get("base_link"), element.get("tip_link")
        if not base or not tip:
            self._problem(element, "a <chain> needs base_link and tip_link: add both")
            return
        try:
            yield from (joint.name for joint in path_to(self._description, tip, base))
        except PlanningError as error:
            self._problem(element, str(error))

    def _with_states(self, groups: Mapping[str, Group]) -> dict[str, Group]:
        """Return the groups with their states."""
        found: dict[str, dict[str, Mapping[str, float]]] = {name: {} for name in groups}
        for element in self._robot.findall("group_state"):
            name, group = element.get("name", ""), element.get("group", "")
            if group not in groups:
                self._unknown(element, "group", group, groups)
            elif not name or name in found[group]:
                self._problem(
                    element, f"a state of {group} has no name, or the same name as another state: give it a unique name"
                )
            else:
                found[group][name] = self._state(element, groups[group])
        return {name: replace(group, states=found[name]) for name, group in groups.items()}

    def _state(self, element: Element, group: Group) -> Mapping[str, float]:
        positions: dict[str, float] = {}
        for joint in element.findall("joint"):
            name = joint.get("name", "")
            if name not in self._description.joints:
                self._unknown(joint, "joint", name, dict.fromkeys(group.joints))
            elif not self._has_own_position(name):
                continue  # MoveIt also writes the mimic joints to a state
            elif name not in group.joints:
                self._problem(joint, f"{name} is not in group {group.name}: remove it from the state")
            elif (position := self._position(joint)) is not None:
                positions[name] = position
        return positions

    def _position(self, element: Element) -> float | None:
        """Return the position of a joint in a state, or None if the element is invalid."""
        name, text = element.get("name", ""), element.get("value", "")
        position = _number(text)
        if not math.isfinite(position):
            self._problem(element, f'{name}: value must be a number, not "{text}"')
        elif problem := outside(self._description.joints[name], position):
            self._problem(element, f"{problem}: correct the value")
        else:
            return position
        return None

    def _end_effectors(self, groups: Mapping[str, Group]) -> dict[str, EndEffector]:
        found: dict[str, EndEffector] = {}
        for name, element in self._named("end_effector").items():
            group, link, arm = (element.get(key, "") for key in ("group", "parent_link", "parent_group"))
            if group not in groups:
                self._unknown(element, "group", group, groups)
            elif link not in self._description.links:
                self._unknown(element, "link", link, self._description.links)
            elif arm and arm not in groups:
                self._unknown(element, "group", arm, groups)
            else:
                found[name] = EndEffector(name, group, link, arm)
        return found


def _number(text: str) -> float:
    """Convert a string to a number, or to NaN if it is not a number."""
    try:
        return float(text)
    except ValueError:
        return math.nan
