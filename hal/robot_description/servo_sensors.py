"""Parse the ``<sensor>`` and ``<gpio>`` elements of ``<ros2_control>`` blocks, which only report values."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element

from hal.hal_errors import DescriptionError
from hal.robot_description.urdf import attribute, doubles
from hal.robot_description.xml_places import place

SENSORS: Final = ("sensor", "gpio")
"""Tags of elements that do not move a joint."""
SERVO_VALUES: Final = ("voltage", "temperature", "current", "load", "alarms")
"""State interfaces of a servo (V, °C, A, fraction of full drive, number of alarms)."""
SERVO_INPUTS: Final = ("external_port_data_1", "external_port_data_2", "external_port_data_3")
"""Registers that a Dynamixel with external ports reports, as raw values."""


@dataclass(frozen=True, slots=True)
class SensorInfo:
    """A ``<sensor>`` or ``<gpio>`` element with its state interfaces."""

    joint: str
    """Joint whose servo reports the values; empty if the hardware itself reports them."""
    interfaces: tuple[str, ...]
    place: str = "the URDF"
    """File and line of the element."""


def parse_sensors(block: Element, joints: Collection[str]) -> dict[str, SensorInfo]:
    """Return a block's sensors, keyed by name.

    Args:
        block: The ``<ros2_control>`` block.
        joints: Names of its joints.

    Raises:
        DescriptionError: A sensor is invalid, or a ``<sensor>`` has a command interface.
    """
    found: dict[str, SensorInfo] = {}
    for element in (child for child in block if child.tag in SENSORS):
        name = attribute(element, "name", f"a <{element.tag}> of '{block.get('name')}'")
        subject, where = f"<{element.tag} name='{name}'>", place(element)
        if name in found or name in joints:
            raise DescriptionError(f"{subject} has the same name as another element ({where}): rename it")
        if element.tag == "sensor" and element.find("command_interface") is not None:
            raise DescriptionError(
                f"{subject} has a <command_interface> ({where}): use <gpio>, or remove the <command_interface>"
            )
        states = element.findall("state_interface")
        interfaces = tuple(attribute(state, "name", f"a <state_interface> of {subject}") for state in states)
        if twice := doubles(interfaces):
            raise DescriptionError(f"{subject} has <state_interface name='{twice[0]}'> twice ({where}): remove one")
        found[name] = SensorInfo(_joint(element, subject, joints, interfaces), interfaces, where)
    return found


def _joint(element: Element, subject: str, joints: Collection[str], interfaces: tuple[str, ...]) -> str:
    """Return the joint that is the source of a sensor, or an empty string."""
    parameters = {p.get("name", ""): (p.text or "").strip() for p in element.findall("param")}
    joint, where = parameters.get("joint", ""), place(element)
    if not joint:
        return ""
    if joint not in joints:
        raise DescriptionError(
            f"{subject} refers to joint '{joint}', which is not in its block ({where}): correct the name"
        )
    outputs = [command.get("name") for command in element.findall("command_interface")]
    if unknown := [name for name in interfaces if name not in (*SERVO_VALUES, *SERVO_INPUTS, *outputs)]:
        raise DescriptionError(
            f"{subject} has the state interface {', '.join(unknown)} ({where}), but the servo of {joint} reports only "
            f"{', '.join((*SERVO_VALUES, *SERVO_INPUTS))} and the outputs of the <gpio>: use one of them"
        )
    return joint
