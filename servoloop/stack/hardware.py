"""Choose and build the hardware components: servos on a port, an arm in MuJoCo, a mock or a user-supplied plugin."""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.driver_errors import PortError
from drivers.port import Port
from drivers.port.serial_port import SerialPort
from drivers.servos.catalog import MODELS
from hal.compensation.gravity import Gravity
from hal.compensation.servo_compliance import Compliance
from hal.components.component_set import ComponentSet
from hal.hal_errors import DescriptionError
from hal.hardware import Hardware
from hal.joint import Joint
from hal.mock_hardware import MockHardware
from hal.outputs import Outputs
from hal.robot_description.description import Description
from hal.robot_description.hardware_info import HardwareInfo
from hal.robot_file.robot import require_positions
from hal.robot_file.robot_file import RobotFile
from hal.servos.gravity_compensation import GravityCompensation
from hal.servos.servo_hardware import ServoHardware
from hal.servos.servo_outputs import ServoOutputs
from servoloop.stack.devices import world_feed
from servoloop.stack.hardware_plugins import plugin_hardware, plugin_names
from servoloop.stack.line_rate import RatedLine
from servoloop.stack.robot_files import Files
from sim_backend.scene.world_feed import EmulatedScene, Pose, WorldFeedClient

if TYPE_CHECKING:
    from servoloop.stack.virtual_lines import VirtualLines

LOG = logging.getLogger("servoloop")

OpenPort = Callable[[str, int, Clock], Port]
"""Function that opens a device at a baud rate in bit/s."""


class HardwareKind(StrEnum):
    """Values of ``--hardware``."""

    SERVOS = "servos"
    MUJOCO = "mujoco"
    MOCK = "mock"


PLUGINS = {
    "servoloop/ServoHardware": HardwareKind.SERVOS,
    "servoloop/MujocoHardware": HardwareKind.MUJOCO,
    "mock_components/GenericSystem": HardwareKind.MOCK,
}
SUCCESSORS = {"fake_components/GenericSystem": "mock_components/GenericSystem"}
"""Outdated plugin names and their replacements."""


@dataclass(frozen=True, slots=True)
class HardwareSetup:
    """Hardware of the control loop, with its buses and properties."""

    hardware: ComponentSet
    scene: Callable[[], Mapping[str, Pose]]
    """Function that returns the poses of all objects in the world, keyed by name."""
    set_compensation: Mapping[str, Callable[[bool], None]]
    """Functions that switch the gravity compensation on or off, keyed by the name of a component with servos."""
    virtual: bool
    """Whether all hardware is simulated."""
    buses: Mapping[str, RatedLine]
    """Buses opened so far, keyed by name."""
    rates_hz: Mapping[str, float]
    """Read and write rate of each bus, in Hz."""
    compliances: Mapping[str, Compliance]
    """Known servo compliances, keyed by joint name."""
    outputs: Outputs = field(default_factory=Outputs)
    """Outputs of all components. Outputs are not joints and do not move anything."""


def choose(kind: HardwareKind | None, component: HardwareInfo) -> HardwareKind | str:
    """Return the hardware type from the command line or, if it is not given, the ``<plugin>`` of the component."""
    plugin = SUCCESSORS.get(component.plugin, component.plugin)
    users = plugin_names()
    if kind is None and plugin not in PLUGINS and plugin not in users:
        known = ", ".join([*PLUGINS, *users])
        raise DescriptionError(f"{component.name}: unknown <plugin> {plugin}: choose one of {known}")
    return kind or PLUGINS.get(plugin) or plugin


def build(
    kind: HardwareKind | None,
    files: Files,
    devices: Mapping[str, str],
    clock: Clock,
    virtual: "VirtualLines | None" = None,
    tap: Callable[[Port, Clock], Port] = lambda port, clock: port,
) -> HardwareSetup:
    """Build all hardware components without opening any device.

    Args:
        kind: Hardware type of all components. If None, the ``<plugin>`` of each component decides.
        files: Files of the robot.
        devices: Device paths, keyed by bus name.
        clock: Clock of the hardware.
        virtual: Virtual buses within this process. If given, ``devices`` maps each bus to the name of its virtual bus.
        tap: Function that wraps each port, for example to record its bytes.
    """
    components = files.description.components
    kinds = {component.name: choose(kind, component) for component in components}
    for component in (component for component in components if component.plugin in SUCCESSORS):
        successor = SUCCESSORS[component.plugin]
        LOG.warning("%s: <plugin> %s is outdated; use %s instead", component.name, component.plugin, successor)
    in_mujoco = [component for component in components if kinds[component.name] is HardwareKind.MUJOCO]
    if len(in_mujoco) > 1:
        raise DescriptionError("only one component can run in MuJoCo: use servos or mocks for the other components")
    world = _World(clock, files.scene, in_mujoco[0].joints) if in_mujoco else None
    below: OpenPort = virtual.open if virtual else SerialPort

    def open_port(device: str, baud: int, clock: Clock) -> Port:
        return tap(below(device, baud, clock), clock)

    outputs = Outputs(files.component.outputs)
    builder = _ComponentBuilder(files, devices, clock, world, open_port, outputs)
    made = [builder.build(kinds[component.name], component) for component in components]
    divisors = [_rw_divisor(component, files.controllers.update_rate_hz) for component in components]
    servos = {one.name: _compensation_switch(one) for one in made if isinstance(one, ServoHardware)}
    feed = _feed(devices) if servos and not virtual else None
    scene = world.scene if world else virtual.scene if virtual else EmulatedScene(feed) if feed else dict
    users = any(kind not in tuple(HardwareKind) for kind in kinds.values())
    real = users or (bool(servos) and feed is None and virtual is None)
    rates_hz = _rates_hz(files, divisors)
    driven = {joint for one in made if isinstance(one, ServoHardware) for joint in one.joints}
    lagging = compliances(joint for joint in files.robot.joints if joint.name in driven)
    components_set = ComponentSet(made, clock, divisors)
    return HardwareSetup(components_set, scene, servos, not real, builder.buses, rates_hz, lagging, outputs)


def compliances(joints: Iterable[Joint]) -> dict[str, Compliance]:
    """Return the known servo compliances, keyed by joint name."""
    return {joint.name: joint.compliance for joint in joints if joint.compliance is not None}


def _feed(devices: Mapping[str, str]) -> WorldFeedClient | None:
    """Connect to the world feed of the emulator that serves these devices. Return None for a real bus or an emulator
    that was killed."""
    path = world_feed(devices)
    try:
        return WorldFeedClient(path) if path else None
    except OSError:
        return None


def _rw_divisor(component: HardwareInfo, update_rate_hz: int) -> int:
    """Return the divisor of the update rate that yields the component's ``rw_rate``; at least 1."""
    return max(1, round(update_rate_hz / component.rw_rate)) if component.rw_rate else 1


def _rates_hz(files: Files, divisors: Sequence[int]) -> dict[str, float]:
    """Return the read and write rate of each bus, in Hz."""
    return {
        joint.bus: files.controllers.update_rate_hz / divisor
        for component, divisor in zip(files.description.components, divisors, strict=True)
        for joint in files.robot.joints
        if joint.name in component.joints
    }


@dataclass(frozen=True, slots=True)
class _ComponentBuilder:
    """Builder of the hardware components of one robot."""

    files: Files
    devices: Mapping[str, str]
    clock: Clock
    world: "_World | None"
    open_port: OpenPort
    outputs: Outputs
    buses: dict[str, RatedLine] = field(default_factory=dict)
    """Buses opened so far, keyed by name."""

    def build(self, kind: HardwareKind | str, component: HardwareInfo) -> Hardware:
        """Build one component without opening a device.

        Raises DescriptionError if the robot file of the component is missing.
        """
        joints = [joint for joint in self.files.robot.joints if joint.name in component.joints]
        if kind is HardwareKind.MOCK:
            return MockHardware.of(component, self.clock, self.outputs)
        if not isinstance(kind, HardwareKind):
            return plugin_hardware(kind, component, self.clock)
        require_positions(component)
        if len(joints) != len(component.joints):
            raise DescriptionError(
                f"{component.name} has servos but no robot file: specify the file in its <hardware> as "
                '<param name="robot">'
            )
        if self.world is not None and kind is HardwareKind.MUJOCO:
            return self.world.hardware(component, joints)
        names = list(dict.fromkeys(joint.bus for joint in joints))
        carried = compensation(joints, self.files.description)
        outputs = ServoOutputs(component, joints, self.outputs)
        each = {name: partial(self._open, name) for name in names}
        return ServoHardware(component.name, joints, each, self.clock, carried, outputs)

    def _open(self, name: str) -> Bus:
        bus = open_buses(self.files.robot.file, self.devices, self.clock, [name], self.open_port)[name]
        self.buses[name] = bus
        return bus


def compensation(joints: Sequence[Joint], description: Description) -> GravityCompensation | None:
    """Return the gravity compensation for these joints, or None if the robot file does not enable gravity compensation.

    The log lists the joints whose servo stiffness is unknown.

    Args:
        joints: Joints of one component.
        description: Robot description, including link masses.
    """
    if not any(joint.gravity_compensation for joint in joints):
        return None
    if unknown := [joint.name for joint in joints if joint.compliance is None]:
        names = ", ".join(unknown)
        LOG.info("%s: the servo stiffness is unknown, so sag and lag are not compensated", names)
    return GravityCompensation(joints, Gravity(description, [joint.name for joint in joints]))


def _compensation_switch(hardware: ServoHardware) -> Callable[[bool], None]:
    def set_compensation(on: bool) -> None:
        if hardware.compensation is not None:
            hardware.compensation.enabled = on

    return set_compensation


class _World:
    """MuJoCo world with the arm and the objects around it."""

    def __init__(self, clock: Clock, scene: Path, joints: Sequence[str]) -> None:
        from sim_backend.scene.scene_check import require_scene
        from sim_backend.scene.world import World

        require_scene(scene, joints)
        self._world = World(scene)
        self._world.hold_until_driven()
        self._clock = clock

    def hardware(self, component: HardwareInfo, joints: Sequence[Joint]) -> Hardware:
        """Return the component that moves the arm in MuJoCo."""
        from sim_backend.scene.mujoco_hardware import MujocoHardware

        made = MujocoHardware(component.name, joints, self._world, self._clock)
        made.outputs = tuple(component.outputs)
        return made

    def scene(self) -> Mapping[str, Pose]:
        """Return the poses of all objects in the world, keyed by name."""
        return {n: (p.position_m, p.quaternion_xyzw) for n, p in self._world.poses().items()}


def servo_bus(robot: RobotFile, port: Port, clock: Clock, bus: str = "") -> Bus:
    """Return the bus with this name and its servos. If the robot has only one bus, the name of the bus is empty."""
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
    """Open buses on their devices. If a bus cannot be opened, close the buses that are already open.

    Args:
        robot: The robot file.
        devices: Device paths, keyed by bus name.
        clock: Clock of the buses.
        names: Names of the buses to open; None for all buses.
        open_port: Function that opens a device.

    Returns:
        Open buses, keyed by name.
    """
    buses: dict[str, Bus] = {}
    lines = robot.lines()
    try:
        for name in lines if names is None else names:
            port = open_port(devices[name], lines[name].baud, clock)
            buses[name] = _driven(robot, port, clock, name)
    except BaseException:
        for bus in buses.values():
            with suppress(PortError):  # Closing a device that was unplugged fails.
                bus.close()
        raise
    return buses


def _driven(robot: RobotFile, port: Port, clock: Clock, name: str) -> Bus:
    """Return the bus on this port. Close the port if an error occurs."""
    try:
        return servo_bus(robot, port, clock, name)
    except BaseException:
        port.close()
        raise
