"""Which hardware: servos on a port, the arm in MuJoCo, or the mock. Nothing else differs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from drivers.bus import ServoBus
from drivers.clock import Clock
from drivers.makes import MODELS, bus_for
from drivers.port import Port
from drivers.serial_port import SerialPort
from hal.description import Vector
from hal.errors import DescriptionError
from hal.kinematics import Quaternion
from hal.lifecycle import Hardware
from hal.mock_hardware import MockHardware
from hal.robot import RobotFile
from hal.servo_hardware import ServoHardware
from servoloop.files import Files
from servoloop.ports import world_feed
from sim_backend.world_feed import WorldFeedClient

Pose = tuple[Vector, Quaternion]


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


@dataclass(frozen=True, slots=True)
class Below:
    """What the loop stands on."""

    hardware: Hardware
    scene: Callable[[], Mapping[str, Pose]]
    set_interpolation: Callable[[bool], None] | None
    virtual: bool
    """Whether nothing real moves."""


def choose(kind: HardwareKind | None, files: Files) -> HardwareKind:
    """What the command line says, or else the URDF's ``<plugin>``."""
    plugin = files.component.plugin
    if kind is None and plugin not in PLUGINS:
        raise DescriptionError(f"unknown <plugin> {plugin}: known are {', '.join(PLUGINS)}")
    return kind or PLUGINS[plugin]


def build(kind: HardwareKind, files: Files, devices: Mapping[str, str], clock: Clock) -> Below:
    """The hardware component, unconfigured: nothing is opened yet. ``devices``: paths by bus name."""
    if kind is HardwareKind.MOCK:
        dynamics = files.component.parameters.get("calculate_dynamics", "false").lower() == "true"
        mock = MockHardware(files.component.name, files.component.joints, clock, dynamics)
        return Below(mock, dict, None, virtual=True)
    if kind is HardwareKind.MUJOCO:
        return _mujoco(files, clock)
    return _servos(files, devices, clock)


def _mujoco(files: Files, clock: Clock) -> Below:
    from sim_backend.mujoco_hardware import MujocoHardware
    from sim_backend.world import World

    world = World()
    hardware = MujocoHardware(files.component.name, files.robot.joints, world, clock)

    def scene() -> Mapping[str, Pose]:
        return {n: (p.position_m, p.quaternion_xyzw) for n, p in world.poses().items()}

    return Below(hardware, scene, None, virtual=True)


def servo_bus(robot: RobotFile, port: Port, clock: Clock, bus: str = "") -> ServoBus:
    """The bus of this name (empty where there is only one), driving the servos that are on it."""
    joints = robot.joints_on(bus).values()
    gains = {joint.servo_id: joint.position_p for joint in joints if joint.position_p is not None}
    return bus_for({joint.servo_id: MODELS[joint.model] for joint in joints}, port, clock, gains)


def open_buses(robot: RobotFile, devices: Mapping[str, str], clock: Clock) -> dict[str, ServoBus]:
    """Every bus on its device, by name. Where one cannot be opened, the others are given back."""
    buses: dict[str, ServoBus] = {}
    try:
        for name, line in robot.lines().items():
            buses[name] = servo_bus(robot, SerialPort(devices[name], line.baud, clock), clock, name)
    except BaseException:
        for bus in buses.values():
            bus.close()
        raise
    return buses


def _servos(files: Files, devices: Mapping[str, str], clock: Clock) -> Below:
    robot = files.robot
    hardware = ServoHardware(files.component.name, robot.joints, lambda: open_buses(robot.file, devices, clock), clock)

    def set_interpolation(on: bool) -> None:
        hardware.interpolate = on

    feed = world_feed(devices)
    scene = Scene(WorldFeedClient(feed)) if feed else dict
    return Below(hardware, scene, set_interpolation, virtual=feed is not None)


class Scene:
    """The newest poses that an emulator published."""

    def __init__(self, client: WorldFeedClient) -> None:
        self._client = client
        self._poses: dict[str, Pose] = {}

    def __call__(self) -> Mapping[str, Pose]:
        newest = self._client.newest()
        if newest is not None:
            self._poses = {
                name: (tuple(pose["position_m"]), tuple(pose["quaternion_xyzw"]))
                for name, pose in newest["poses"].items()
            }
        return self._poses
