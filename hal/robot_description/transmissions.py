"""Parse the ``<transmission>`` elements of ``<ros2_control>`` blocks: gears between a servo and its joint."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element

from hal.hal_errors import DescriptionError
from hal.robot_description.urdf import attribute, finite
from hal.robot_description.xml_places import place

SIMPLE: Final = "transmission_interface/SimpleTransmission"


@dataclass(frozen=True, slots=True)
class SimpleTransmission:
    """A gear between one servo and one joint: joint position = servo position / reduction + offset."""

    reduction: float = 1.0
    """Turns of the servo per turn of the joint; negative if they rotate in opposite directions."""
    offset: float = 0.0
    """Joint position when the servo position is 0, in rad or m."""


NO_GEAR: Final = SimpleTransmission()


def parse_transmissions(block: Element, joints: Mapping[str, Element]) -> dict[str, SimpleTransmission]:
    """Return a block's transmissions, keyed by joint name.

    Args:
        block: The ``<ros2_control>`` block.
        joints: The block's ``<joint>`` elements, keyed by name.

    Raises:
        DescriptionError: A transmission is invalid or is not a SimpleTransmission.
    """
    found: dict[str, SimpleTransmission] = {}
    for element in block.findall("transmission"):
        name = attribute(element, "name", f"a <transmission> of '{block.get('name')}'")
        subject, where = f"<transmission name='{name}'>", place(element)
        plugin = element.findtext("plugin", "").strip()
        if plugin != SIMPLE:
            raise DescriptionError(
                f"{subject} is a {plugin or 'transmission without <plugin>'} ({where}): use {SIMPLE}"
            )
        ends, actuators = element.findall("joint"), element.findall("actuator")
        if len(ends) != 1 or len(actuators) != 1:
            raise DescriptionError(f"{subject} needs one <joint> and one <actuator> ({where}): correct the element")
        joint = attribute(ends[0], "name", f"a <joint> of {subject}")
        if joint not in joints:
            raise DescriptionError(
                f"{subject} refers to joint '{joint}', which is not in its block ({where}): add the joint"
            )
        if joint in found:
            raise DescriptionError(f"{subject}: joint '{joint}' has two transmissions ({where}): remove one")
        if _number(subject, actuators[0], "mechanical_reduction", 1.0) != 1.0:
            raise DescriptionError(f"{subject}: move <mechanical_reduction> from <actuator> to <joint> ({where})")
        found[joint] = _simple(subject, ends[0])
    return found


def _simple(subject: str, joint: Element) -> SimpleTransmission:
    reduction = _number(subject, joint, "mechanical_reduction", 1.0)
    if not 1e-3 <= abs(reduction) <= 1e3:
        raise DescriptionError(
            f"{subject}: mechanical_reduction must be from 0.001 to 1000, or from -1000 to -0.001, not {reduction} "
            f"({place(joint)})"
        )
    return SimpleTransmission(reduction, _number(subject, joint, "offset", 0.0))


def _number(subject: str, element: Element, tag: str, default: float) -> float:
    text = element.findtext(tag)
    try:
        return default if text is None else finite(text)
    except ValueError as error:
        raise DescriptionError(f"{subject}: {tag} must be a number, not '{text}' ({place(element)})") from error
