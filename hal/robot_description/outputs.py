"""Parse the outputs of ``<ros2_control>`` blocks: command interfaces that do not move a joint."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element

from hal.hal_errors import DescriptionError
from hal.robot_description.command_ranges import parse_command_range
from hal.robot_description.urdf import attribute, finite
from hal.robot_description.xml_places import place

COMMANDS: Final = ("position", "velocity", "effort")
"""Command interfaces that move a joint."""


@dataclass(frozen=True, slots=True)
class OutputInfo:
    """Command interface of a ``<gpio>``, or a command interface of a joint other than position, velocity or effort."""

    joint: str
    """Joint whose servo has the output. The name is empty if the output belongs to the hardware itself."""
    lowest: float = -math.inf
    highest: float = math.inf
    initial: float = math.nan
    """Value before the first command; NaN if there is none."""
    place: str = "the URDF"
    """File and line of the interface."""


def parse_outputs(block: Element) -> dict[str, OutputInfo]:
    """Return a block's outputs, keyed by interface (``lamp/led``). Raises DescriptionError."""
    found: dict[str, OutputInfo] = {}
    for element in (child for child in block if child.tag in ("joint", "gpio")):
        name = attribute(element, "name", f"a <{element.tag}> of '{block.get('name')}'")
        parameters = {one.get("name", ""): (one.text or "").strip() for one in element.findall("param")}
        joint = name if element.tag == "joint" else parameters.get("joint", "")
        for command in element.findall("command_interface"):
            kind = attribute(command, "name", f"a <command_interface> of '{name}'")
            if element.tag == "joint" and kind in COMMANDS:
                continue
            interface = f"{name}/{kind}"
            if interface in found:
                raise DescriptionError(
                    f"<{element.tag} name='{name}'> has <command_interface name='{kind}'> twice ({place(command)}): "
                    "remove one"
                )
            found[interface] = _output(interface, joint, command)
    return found


def _output(interface: str, joint: str, command: Element) -> OutputInfo:
    limits = parse_command_range(interface, command)
    texts: Mapping[str, str] = {one.get("name", ""): (one.text or "").strip() for one in command.findall("param")}
    try:
        initial = finite(texts["initial_value"]) if "initial_value" in texts else math.nan
    except ValueError as error:
        raise DescriptionError(
            f"initial_value of {interface} must be a number, not '{texts['initial_value']}' ({place(command)})"
        ) from error
    if limits is None:
        return OutputInfo(joint, initial=initial, place=place(command))
    return OutputInfo(joint, limits.lowest, limits.highest, initial, place(command))
