"""The choice of the hardware: servos on a port, the arm in MuJoCo, the mock, or a user's own. Nothing else differs."""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from controller.manager.plugins import PluginError, why_not_loaded
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.errors import PortError
from drivers.port import Port
from drivers.port.serial_port import SerialPort
from drivers.servos.catalog import MODELS
from hal.compensation.gravity import Gravity
from hal.compensation.gravity_compensation import GravityCompensation
from hal.compensation.servo_compliance import Compliance
from hal.components.component_set import ComponentSet
from hal.errors import DescriptionError, HalError
from hal.hardware import Hardware
from hal.joint import Joint
from hal.mock_hardware import MockHardware
from hal.robot_description.description import Description
from hal.robot_description.hardware_info import HardwareInfo
from hal.robot_file.robot import require_positions
from hal.robot_file.robot_file import RobotFile
from hal.servos.servo_hardware import ServoHardware
from servoloop.stack.devices import world_feed
from servoloop.stack.emulator import EmulatedScene, Pose
from servoloop.stack.line_rate import Line
from servoloop.stack.robot_files import Files
from sim_backend.scene.world_feed import WorldFeedClient

if TYPE_CHECKING:
    from servoloop.stack.virtual_lines import VirtualLines

LOG = logging.getLogger("servoloop")

OpenPort = Callable[[str, int, Clock], Port]
"""Opens a device at a rate in bit/s."""


class HardwareKind(StrEnum):
    """The values of ``--hardware``."""

    SERVOS = "servos"
    MUJOCO = "mujoco"
    MOCK = "mock"


PLUGINS = {
    "servoloop/ServoHardware": HardwareKind.SERVOS,
    "servoloop/MujocoHardware": HardwareKind.MUJOCO,
    "mock_components/GenericSystem": HardwareKind.MOCK,
}
SUCCESSORS = {"fake_components/GenericSystem": "mock_components/GenericSystem"}
"""Plugins of older releases, and those that took their place."""
ENTRY_POINTS = "servoloop.hardware"
"""The group of entry points in which a user's package names its hardware: ``package/Class = module:make``, where
``make(component, clock)`` returns a hal.hardware.Hardware of that ``<ros2_control>`` block."""


@dataclass(frozen=True, slots=True)
class HardwareSetup:
    """The hardware that the loop drives, and what belongs to it."""

    hardware: ComponentSet
    scene: Callable[[], Mapping[str, Pose]]
    set_compensation: Mapping[str, Callable[[bool], None]]
    """By component, where it has servos."""
    virtual: bool
    """Whether nothing real moves."""
    buses: Mapping[str, Line]
    """By name, those that components have opened so far."""
    rates_hz: Mapping[str, float]
    """By bus: how often its servos are read and written."""
    compliances: Mapping[str, Compliance]
    """How far servos lag, by joint, as far as is known."""


def choose(kind: HardwareKind | None, component: HardwareInfo) -> HardwareKind | str:
    """Choose a component's hardware: what the command line says, or else its ``<plugin>``, ours or a user's."""
    plugin = SUCCESSORS.get(component.plugin, component.plugin)
    users = sorted(entry_points(group=ENTRY_POINTS).names)
    if kind is None and plugin not in PLUGINS and plugin not in users:
        known = ", ".join([*PLUGINS, *users])
        raise DescriptionError(f"{component.name}: unknown <plugin> {plugin}: known are {known}")
    return kind or PLUGINS.get(plugin) or plugin


def build(
    kind: HardwareKind | None,
    files: Files,
    devices: Mapping[str, str],
    clock: Clock,
    virtual: "VirtualLines | None" = None,
    tap: Callable[[Port, Clock], Port] = lambda port, clock: port,
) -> HardwareSetup:
    """Make all hardware components, unconfigured: nothing is opened yet. ``devices``: paths by bus name.

    ``virtual``: lines within this process, which the devices name then. ``tap`` may put something around each port.
    """
    components = files.description.components
    kinds = {component.name: choose(kind, component) for component in components}
    for component in (component for component in components if component.plugin in SUCCESSORS):
        successor = SUCCESSORS[component.plugin]
        LOG.warning("%s: <plugin> %s is outdated: write %s", component.name, component.plugin, successor)
    in_mujoco = [component for component in components if kinds[component.name] is HardwareKind.MUJOCO]
    if len(in_mujoco) > 1:
        raise DescriptionError("only one component can be the arm in MuJoCo: make the others servos or mocks")
    world = _World(clock, files.scene, in_mujoco[0].joints) if in_mujoco else None
    below: OpenPort = virtual.open if virtual else SerialPort

    def open_port(device: str, baud: int, clock: Clock) -> Port:
        return tap(below(device, baud, clock), clock)

    builder = _ComponentBuilder(files, devices, clock, world, open_port)
    made = [builder.build(kinds[component.name], component) for component in components]
    divisors = [_rw_divisor(component, files.controllers.update_rate_hz) for component in components]
    servos = {one.name: _compensation_switch(one) for one in made if isinstance(one, ServoHardware)}
    feed = _feed(devices) if servos and not virtual else None
    scene = world.scene if world else virtual.scene if virtual else EmulatedScene(feed) if feed else dict
    users = any(kind not in tuple(HardwareKind) for kind in kinds.values())
    real = users or (bool(servos) and feed is None and virtual is None)
    rate_hz = files.controllers.update_rate_hz
    rates_hz = {
        joint.bus: rate_hz / divisor
        for component, divisor in zip(components, divisors, strict=True)
        for joint in files.robot.joints
        if joint.name in component.joints
    }
    driven = {joint for one in made if isinstance(one, ServoHardware) for joint in one.joints}
    lagging = compliances(joint for joint in files.robot.joints if joint.name in driven)
    return HardwareSetup(ComponentSet(made, clock, divisors), scene, servos, not real, builder.buses, rates_hz, lagging)


def compliances(joints: Iterable[Joint]) -> dict[str, Compliance]:
    """The compliances of servos by joint, as far as they are known."""
    return {joint.name: joint.compliance for joint in joints if joint.compliance is not None}


def _feed(devices: Mapping[str, str]) -> WorldFeedClient | None:
    """Connect to the world behind these devices. A real line has none, nor has an emulator that was killed."""
    path = world_feed(devices)
    try:
        return WorldFeedClient(path) if path else None
    except OSError:
        return None


def _rw_divisor(component: HardwareInfo, update_rate_hz: int) -> int:
    """The divisor of the update rate at which the component's ``rw_rate`` has it read and written; 1 at the least."""
    return max(1, round(update_rate_hz / component.rw_rate)) if component.rw_rate else 1


@dataclass(frozen=True, slots=True)
class _ComponentBuilder:
    """Builds the hardware components of one robot."""

    files: Files
    devices: Mapping[str, str]
    clock: Clock
    world: "_World | None"
    open_port: OpenPort
    buses: dict[str, Line] = field(default_factory=dict)
    """By name, the buses that components have opened so far."""

    def build(self, kind: HardwareKind | str, component: HardwareInfo) -> Hardware:
        """Build one component; nothing is opened yet. Raises DescriptionError if it lacks a robot file."""
        joints = [joint for joint in self.files.robot.joints if joint.name in component.joints]
        if kind is HardwareKind.MOCK:
            return MockHardware.of(component, self.clock)
        if not isinstance(kind, HardwareKind):
            return _users(kind, component, self.clock)
        require_positions(component)
        if len(joints) != len(component.joints):
            raise DescriptionError(
                f'{component.name} has servos and no robot file: name it in its <hardware> as <param name="robot">'
            )
        if self.world is not None and kind is HardwareKind.MUJOCO:
            return self.world.hardware(component.name, joints)
        names = list(dict.fromkeys(joint.bus for joint in joints))
        carried = compensation(joints, self.files.description)
        return ServoHardware(component.name, joints, lambda: self._open(names), self.clock, carried)

    def _open(self, names: Sequence[str]) -> Mapping[str, Bus]:
        buses = open_buses(self.files.robot.file, self.devices, self.clock, names, self.open_port)
        self.buses.update(buses)
        return buses


def compensation(joints: Sequence[Joint], description: Description, guided: bool = False) -> GravityCompensation | None:
    """The gravity compensation of a component's joints; None where the robot file does without. ``guided``: by a hand.

    Joints of whose servos too little is known are named in the log.
    """
    if not any(joint.gravity_compensation for joint in joints):
        return None
    if unknown := [joint.name for joint in joints if joint.compliance is None]:
        names = ", ".join(unknown)
        LOG.info("%s: the servo's stiffness is unknown, its sag and its lag are not compensated", names)
    return GravityCompensation(joints, Gravity(description, [joint.name for joint in joints]), guided)


def _users(plugin: str, component: HardwareInfo, clock: Clock) -> Hardware:
    """Make the hardware that an installed package brings. Raises PluginError."""
    (point,) = entry_points(group=ENTRY_POINTS, name=plugin)
    try:
        hardware: Hardware = point.load()(component, clock)
    except HalError:
        raise  # it says what to mend
    except Exception as error:  # whatever a user's module does when it is imported
        raise PluginError(f"the hardware {plugin} {why_not_loaded(point, error)}") from error
    _check_names(hardware, component)
    return hardware


def _check_names(hardware: Hardware, component: HardwareInfo) -> None:
    """Check that a user's hardware has the joints and the command interfaces of its block. Raises PluginError."""
    pairs: tuple[tuple[str, object, object], ...] = (
        ("name", hardware.name, component.name),
        ("joints", tuple(hardware.joints), component.joints),
        ("command_interfaces", tuple(hardware.command_interfaces), component.commands),
    )
    for attribute, has, needs in pairs:
        if has != needs:
            raise PluginError(
                f"the hardware {component.plugin} has the {attribute} {has}, and its <ros2_control> block "
                f"'{component.name}' has {needs}: take them from the component that the class is made with"
            )


def _compensation_switch(hardware: ServoHardware) -> Callable[[bool], None]:
    def set_compensation(on: bool) -> None:
        if hardware.compensation is not None:
            hardware.compensation.enabled = on

    return set_compensation


class _World:
    """The arm in MuJoCo, and the things around it."""

    def __init__(self, clock: Clock, scene: Path, joints: Sequence[str]) -> None:
        from sim_backend.scene.scene_check import require_scene
        from sim_backend.scene.world import World

        require_scene(scene, joints)
        self._world = World(scene)
        self._world.hold_until_driven()
        self._clock = clock

    def hardware(self, name: str, joints: Sequence[Joint]) -> Hardware:
        """The component that moves the arm in MuJoCo."""
        from sim_backend.scene.mujoco_hardware import MujocoHardware

        return MujocoHardware(name, joints, self._world, self._clock)

    def scene(self) -> Mapping[str, Pose]:
        """The poses of all things in the world."""
        return {n: (p.position_m, p.quaternion_xyzw) for n, p in self._world.poses().items()}


def servo_bus(robot: RobotFile, port: Port, clock: Clock, bus: str = "") -> Bus:
    """The bus of this name (empty where there is only one), driving the servos that are on it."""
    joints = robot.joints_on(bus).values()
    gains = {joint.servo_id: joint.position_p for joint in joints if joint.position_p is not None}
    return Bus(port, clock, {joint.servo_id: MODELS[joint.model] for joint in joints}, position_p=gains)


def open_buses(
    robot: RobotFile,
    devices: Mapping[str, str],
    clock: Clock,
    names: Sequence[str] | None = None,
    open_port: OpenPort = SerialPort,
) -> dict[str, Bus]:
    """Open these buses (or all) on their devices, by name. Where one cannot be opened, the others are given back."""
    buses: dict[str, Bus] = {}
    lines = robot.lines()
    try:
        for name in lines if names is None else names:
            port = open_port(devices[name], lines[name].baud, clock)
            buses[name] = _driven(robot, port, clock, name)
    except BaseException:
        for bus in buses.values():
            with suppress(PortError):  # it is gone: there is nothing to give back
                bus.close()
        raise
    return buses


def _driven(robot: RobotFile, port: Port, clock: Clock, name: str) -> Bus:
    """The bus on its port; the port is given back where that fails."""
    try:
        return servo_bus(robot, port, clock, name)
    except BaseException:
        port.close()
        raise
