"""Parse the ``<ros2_control>`` blocks of a URDF. Each block describes one hardware component."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

from hal.hal_errors import DescriptionError
from hal.plausible import range_mistake
from hal.robot_description.command_ranges import CommandRange, parse_command_range
from hal.robot_description.node_names import component_node
from hal.robot_description.outputs import COMMANDS, OutputInfo, parse_outputs
from hal.robot_description.servo_sensors import SENSORS, SensorInfo, parse_sensors
from hal.robot_description.transmissions import SimpleTransmission, parse_transmissions
from hal.robot_description.urdf import UrdfJoint, attribute, doubles, finite
from hal.robot_description.xml_places import place

TYPES = ("system", "actuator", "sensor")
DRIVEN = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, slots=True)
class HardwareInfo:
    """Content of one ``<ros2_control>`` block: the plugin, its parameters and the interfaces of each joint."""

    name: str
    kind: str
    plugin: str
    parameters: Mapping[str, str]
    command_interfaces: Mapping[str, tuple[str, ...]]
    state_interfaces: Mapping[str, tuple[str, ...]]
    mimics: frozenset[str] = frozenset()
    """Joints of the block that have a ``<mimic>`` element in the URDF and are not driven."""
    initial_values: Mapping[str, float] = field(default_factory=dict)
    """Initial values, keyed by state interface (``joint1/position``)."""
    command_ranges: Mapping[str, CommandRange] = field(default_factory=dict)
    """``min`` and ``max`` values, keyed by command interface (``joint1/position``)."""
    transmissions: Mapping[str, SimpleTransmission] = field(default_factory=dict)
    """Gears between servos and joints, keyed by joint name."""
    sensors: Mapping[str, SensorInfo] = field(default_factory=dict)
    """``<sensor>`` and ``<gpio>`` elements, keyed by name."""
    outputs: Mapping[str, OutputInfo] = field(default_factory=dict)
    """Command interfaces that do not move a joint, keyed by name (``lamp/led``)."""
    rw_rate: int = 0
    """Rate at which the component is read and written, in Hz; 0 means every cycle."""
    merged_names: tuple[str, ...] = ()
    """Names of the blocks that were merged into this one. Empty for a single block."""

    @property
    def node_names(self) -> tuple[str, ...]:
        """Names of the ROS nodes of all blocks."""
        return tuple(map(component_node, self.merged_names or (self.name,)))

    @property
    def joints(self) -> tuple[str, ...]:
        """Measured joints in file order: all joints of the block except mimic joints."""
        return tuple(name for name in self.command_interfaces if name not in self.mimics)

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of all command interfaces (``joint1/position``), in file order."""
        return tuple(f"{joint}/{name}" for joint, own in self.command_interfaces.items() for name in own)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of all state interfaces (``joint1/position``), in file order."""
        sensors = {name: sensor.interfaces for name, sensor in self.sensors.items()}
        return tuple(f"{joint}/{name}" for joint, own in {**self.state_interfaces, **sensors}.items() for name in own)

    def flag(self, name: str) -> bool:
        """Return the value of a boolean ``<param>``; False if it is missing."""
        return self.parameters.get(name, "false").lower() == "true"


def merged(components: Sequence[HardwareInfo]) -> HardwareInfo:
    """Merge all blocks into one, which is how the controllers see them."""
    if len(components) == 1:
        return components[0]
    return HardwareInfo(
        name=", ".join(c.name for c in components),
        kind="system",
        plugin="",
        parameters={},
        command_interfaces={joint: names for c in components for joint, names in c.command_interfaces.items()},
        state_interfaces={joint: names for c in components for joint, names in c.state_interfaces.items()},
        mimics=frozenset(joint for c in components for joint in c.mimics),
        initial_values={name: value for c in components for name, value in c.initial_values.items()},
        command_ranges={name: found for c in components for name, found in c.command_ranges.items()},
        transmissions={joint: found for c in components for joint, found in c.transmissions.items()},
        sensors={name: found for c in components for name, found in c.sensors.items()},
        outputs={name: found for c in components for name, found in c.outputs.items()},
        merged_names=tuple(c.name for c in components),
    )


def parse_hardware_info(block: Element, joints: Mapping[str, UrdfJoint]) -> HardwareInfo:
    """Parse one ``<ros2_control>`` block. Raises DescriptionError."""
    name = attribute(block, "name", "a <ros2_control> block")
    hardware = block.find("hardware")
    plugin = "" if hardware is None else hardware.findtext("plugin", "").strip()
    if hardware is None or not plugin:
        raise DescriptionError(f"<ros2_control name='{name}'> has no <hardware><plugin> ({place(block)}): add a plugin")
    parameters = {attribute(p, "name", "a <param>"): (p.text or "").strip() for p in hardware.findall("param")}
    kind = _kind(name, block)
    elements = _block_joints(name, block, joints)
    commands = {j: _motions(e) for j, e in elements.items()}
    _check_commands(f"<ros2_control name='{name}'>", kind, elements, joints)
    return HardwareInfo(
        name=name,
        kind=kind,
        plugin=plugin,
        parameters=parameters,
        command_interfaces=commands,
        state_interfaces={j: _interfaces(e, "state_interface") for j, e in elements.items()},
        mimics=frozenset(j for j in elements if joints[j].mimic is not None),
        initial_values=_initial_values(elements),
        command_ranges=_command_ranges(elements),
        transmissions=parse_transmissions(block, elements),
        sensors=parse_sensors(block, elements),
        outputs=parse_outputs(block),
        rw_rate=_rw_rate(block, block.get("rw_rate", parameters.get("rw_rate", "0"))),
    )


def without_refused_mimics(blocks: Sequence[Element], joints: Mapping[str, UrdfJoint]) -> dict[str, UrdfJoint]:
    """Remove the ``<mimic>`` element of joints for which a block sets ``mimic="false"``. Return all joints.

    Raises:
        DescriptionError: The attribute contradicts the URDF.
    """
    found = dict(joints)
    for element in (element for block in blocks for element in block.findall("joint")):
        name, value = element.get("name", ""), element.get("mimic")
        if name not in joints or value is None:
            continue
        if value.lower() not in ("true", "false"):
            raise DescriptionError(f"joint '{name}': mimic must be true or false, not '{value}' ({place(element)})")
        if value.lower() == "false":
            found[name] = replace(joints[name], mimic=None)
        elif joints[name].mimic is None:
            raise DescriptionError(
                f"joint '{name}' has mimic=\"true\" but no <mimic> in the URDF ({place(element)}): remove the "
                "attribute, or add a <mimic> to the joint"
            )
    return found


def _kind(name: str, block: Element) -> str:
    kind = attribute(block, "type", f"<ros2_control name='{name}'>")
    if kind not in TYPES:
        raise DescriptionError(
            f"<ros2_control name='{name}'> has unknown type '{kind}' ({place(block)}): use one of {', '.join(TYPES)}"
        )
    return kind


def _block_joints(name: str, block: Element, joints: Mapping[str, UrdfJoint]) -> dict[str, Element]:
    """Return the ``<joint>`` elements of a block, keyed by name. Raises DescriptionError for unsupported elements."""
    elements: dict[str, Element] = {}
    for child in block:
        if child.tag not in ("hardware", "joint", "transmission", *SENSORS):
            raise DescriptionError(
                f"<ros2_control name='{name}'> has the unknown tag <{child.tag}> ({place(child)}): remove it"
            )
        if child.tag == "joint":
            joint = attribute(child, "name", f"a joint of '{name}'")
            if joint in elements:
                raise DescriptionError(
                    f"<ros2_control name='{name}'> has joint '{joint}' twice ({place(child)}): remove one"
                )
            _check_driven(f"<ros2_control name='{name}'> has joint '{joint}'", child, joints)
            elements[joint] = child
    return elements


def _check_driven(subject: str, element: Element, joints: Mapping[str, UrdfJoint]) -> None:
    """Check that the hardware can drive a joint. ``subject`` is the beginning of the message."""
    joint = joints.get(element.get("name", ""))
    if joint is None:
        raise DescriptionError(f"{subject}, which is not in the URDF ({place(element)}): correct its name")
    if joint.kind not in DRIVEN:
        raise DescriptionError(
            f"{subject}, which is {joint.kind} in the URDF ({place(element)}): "
            f"hardware can drive only joints of type {', '.join(DRIVEN)}"
        )


def _check_commands(block: str, kind: str, elements: Mapping[str, Element], joints: Mapping[str, UrdfJoint]) -> None:
    """Check that the joints of a block can execute its commands. ``block`` is the block's name in messages."""
    for joint, element in elements.items():
        own, where = _interfaces(element, "command_interface"), place(element)
        if own and kind == "sensor":
            raise DescriptionError(
                f"{block} is a sensor, but joint '{joint}' has a <command_interface> ({where}): remove it"
            )
        mimic = joints[joint].mimic
        if own and mimic is not None:
            raise DescriptionError(
                f"{block}: joint '{joint}' has a <command_interface> but mimics '{mimic.joint}' ({where}): "
                'remove the <command_interface>, or write mimic="false" in its <joint> in this block'
            )


def _rw_rate(block: Element, text: str) -> int:
    if not text.isdecimal() or len(text) > 10:
        raise DescriptionError(
            f"<ros2_control name='{block.get('name')}'>: rw_rate must be a whole number of hertz, not '{text}' "
            f"({place(block)}): correct rw_rate"
        )
    return int(text)


def _command_ranges(elements: Mapping[str, Element]) -> dict[str, CommandRange]:
    ranges: dict[str, CommandRange] = {}
    for joint, element in elements.items():
        for command in element.findall("command_interface"):
            interface = f"{joint}/{command.get('name')}"
            if command.get("name") not in COMMANDS:
                continue
            if found := parse_command_range(interface, command):
                ranges[interface] = found
    return ranges


def _initial_values(elements: Mapping[str, Element]) -> dict[str, float]:
    """Return the ``<param name="initial_value">`` values, keyed by state interface."""
    values: dict[str, float] = {}
    for joint, element in elements.items():
        for state in element.findall("state_interface"):
            for parameter in state.findall("param"):
                if parameter.get("name") == "initial_value":
                    text = (parameter.text or "").strip()
                    interface = f"{joint}/{state.get('name')}"
                    values[interface] = _initial_value(interface, text, place(parameter))
    return values


def _initial_value(interface: str, text: str, where: str) -> float:
    try:
        value = finite(text)
    except ValueError as error:
        raise DescriptionError(f"initial_value of {interface} must be a number, not '{text}' ({where})") from error
    kind = "position" if interface.endswith("/position") else "initial_value"
    if mistake := range_mistake(kind, value):
        raise DescriptionError(f"initial_value of {interface} {mistake} ({where})")
    return value


def _motions(element: Element) -> tuple[str, ...]:
    """Return the command interfaces of a joint that move it."""
    return tuple(name for name in _interfaces(element, "command_interface") if name in COMMANDS)


def _interfaces(element: Element, tag: str) -> tuple[str, ...]:
    names = tuple(attribute(e, "name", f"a <{tag}>") for e in element.findall(tag))
    if twice := doubles(names):
        raise DescriptionError(
            f"joint '{element.get('name')}' has <{tag} name='{twice[0]}'> twice ({place(element)}): remove one"
        )
    return names
