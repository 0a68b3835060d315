"""Read the files of a robot: URDF, robot files and controllers file."""

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import MappingProxyType

from controller.manager.controllers_file import ControllersFile, load_controllers_file
from controller.manager_errors import ControllersFileError
from hal.hal_errors import DescriptionError, RobotFileError
from hal.robot_description.description import Description, merged, parse_urdf
from hal.robot_description.hardware_info import HardwareInfo
from hal.robot_description.xacro_file import SUFFIX, expand_xacro
from hal.robot_file.robot import Robot, assemble
from hal.robot_file.robot_file import load_robot_file
from hal.robot_file.robots import all_limits, together
from hal.text_file import exists, read_xml
from hal.types import JointLimits
from hal.yaml_nodes import YamlFile, compose
from servoloop.stack.shipped_files import ARMS, CONFIG, CONTROLLERS, OWN, SCENE, URDF

LOG = logging.getLogger("servoloop")

NO_ARGUMENTS: Mapping[str, str] = MappingProxyType({})
OWN_SERVOS = ("servoloop/ServoHardware", "servoloop/MujocoHardware")
"""Hardware plugins that need a robot file."""
ROBOT = "robot_arm.yaml"


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoFiles:
    """Contents of the files that describe an arm and its servos: URDF and robot files."""

    description: Description
    component: HardwareInfo
    """All hardware components of the robot, merged into one component."""
    robot: Robot
    """Servos of all components, merged into one robot."""
    limits: dict[str, JointLimits]
    """Limits of every joint with a command interface."""
    urdf_path: Path
    xacro_arguments: Mapping[str, str] = field(default_factory=dict)
    """Arguments of the URDF, keyed by name, if the URDF is written in xacro."""
    robot_paths: dict[str, Path]
    """Robot file of each component that needs one."""
    scene: Path = SCENE
    """Scene of the simulated world."""
    arm: str = OWN
    """Name of the arm. Other programs use this name to find the running stack."""
    folder: Path | None = None
    """Folder for the arm's poses; None if the files do not belong to an arm."""
    arm_folder: Path = ARMS / OWN
    """Folder of the arm to which the other files belong."""

    @property
    def robot_path(self) -> Path:
        """Robot file of the first component that has one."""
        return next(iter(self.robot_paths.values()), CONFIG / ROBOT)

    @property
    def servo_options(self) -> tuple[str, ...]:
        """Options that make ``servoloop emulate`` read the same files in another process.

        If there are several robot files, the URDF lists them, so they need no option.
        """
        paths = {"arm": self.arm_folder, "urdf": self.urdf_path}
        if len(self.robot_paths) == 1:
            paths["robot"] = self.robot_path
        arguments = [f"{name}:={value}" for name, value in self.xacro_arguments.items()]
        return (*_options(paths), *(word for argument in arguments for word in ("--xacro-arg", argument)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Files(ServoFiles):
    """Contents of all files of an arm, including the controllers file."""

    controllers: ControllersFile

    @property
    def namespace(self) -> str:
        """Namespace of all ROS nodes of the stack; empty for the root namespace."""
        return self.controllers.namespace

    @property
    def hand_joints(self) -> set[str]:
        """Joints without a trajectory controller, such as gripper joints."""
        driven = {
            joint
            for spec in self.controllers.controllers
            if spec.kind.endswith("JointTrajectoryController")
            for joint in getattr(spec.parameters, "joints", ())
        }
        return {joint for component in self.description.components for joint in component.joints} - driven

    @property
    def options(self) -> tuple[str, ...]:
        """Options that make ``servoloop up`` read the same files in another process."""
        namespace = ("--namespace", self.namespace) if self.namespace else ()
        return (*self.servo_options, *_options({"controllers": self.controllers.path}), *namespace)


def _options(paths: Mapping[str, Path]) -> tuple[str, ...]:
    return tuple(argument for name, path in paths.items() for argument in (f"--{name}", str(path.absolute())))


def read_files(
    urdf: Path = URDF, controllers: Path = CONTROLLERS, robot: Path | None = None, scene: Path = SCENE
) -> Files:
    """Read and check the files of a robot.

    Args:
        urdf: Path of the URDF.
        controllers: Path of the controllers file.
        robot: Path of the robot file; None for the file in the URDF's ``robot`` parameter.
        scene: Path of the scene.

    Raises:
        DescriptionError: The URDF has errors.
        RobotFileError: The robot file has errors.
        ControllersFileError: The controllers file has errors.
    """
    servos = read_servo_files(urdf, robot, scene)
    return with_controllers(servos, controllers)


def with_controllers(servos: ServoFiles, controllers: Path, namespace: str = "") -> Files:
    """Read a controllers file and check that it matches these servos. Raises ControllersFileError.

    Args:
        servos: Files of the servos.
        controllers: Path of the controllers file.
        namespace: Namespace of all ROS nodes of the stack; empty for the root namespace.
    """
    defaults = servos.robot.file.controller_defaults
    origin = compose(servos.robot_path, ControllersFileError) if defaults else None
    loaded = load_controllers_file(controllers, defaults, servos.component, origin, namespace)
    known = {one.name: getattr(servos, one.name) for one in fields(servos)}
    return Files(**known, controllers=loaded)


def read_servo_files(
    urdf: Path = URDF,
    robot: Path | None = None,
    scene: Path = SCENE,
    xacro_arguments: Mapping[str, str] = NO_ARGUMENTS,
    folders: Sequence[Path] = (),
) -> ServoFiles:
    """Read and check the files of an arm without its controllers file. Raises DescriptionError or RobotFileError.

    Args:
        urdf: Path of the URDF.
        robot: Path of the robot file; None for the file in the URDF's ``robot`` parameter.
        scene: Path of the scene.
        xacro_arguments: Arguments of the URDF, keyed by name.
        folders: Folders with the robot files that the URDF names, searched after the folder of the URDF.
    """
    description = read_description(urdf, xacro_arguments)
    for warning in description.warnings:
        LOG.warning("%s", warning)
    paths = _robot_paths(description, urdf, robot, folders)
    parts = [(c, _robot(paths[c.name], description, c)) for c in description.components if c.name in paths]
    whole = together(parts)
    return ServoFiles(
        description=description,
        component=merged(description.components),
        robot=whole,
        limits=all_limits(description.components, whole, description.joints),
        urdf_path=urdf,
        xacro_arguments=xacro_arguments,
        robot_paths=paths,
        scene=scene,
    )


def read_description(urdf: Path, xacro_arguments: Mapping[str, str] = NO_ARGUMENTS) -> Description:
    """Read the URDF, and expand it first if it is written in xacro. Raises DescriptionError."""
    if urdf.suffix == SUFFIX:
        return parse_urdf(expand_xacro(urdf, xacro_arguments), f"{urdf} (expanded)")
    if xacro_arguments:
        raise DescriptionError(f"--xacro-arg requires a xacro file, but {urdf} does not end in {SUFFIX}: rename it")
    try:
        return parse_urdf(read_xml(urdf, DescriptionError, "the URDF"), str(urdf))
    except DescriptionError as error:
        named = str(urdf) in str(error)
        raise DescriptionError(str(error) if named else f"{urdf}: {error}") from error


def _robot_paths(description: Description, urdf: Path, robot: Path | None, folders: Sequence[Path]) -> dict[str, Path]:
    """Return the path of each component's robot file, if it needs one: ``robot``, or its ``robot`` parameter if
    ``robot`` is None."""
    needy = [c for c in description.components if "robot" in c.parameters or c.plugin in OWN_SERVOS]
    if robot is None:
        return {c.name: _found(c.parameters.get("robot", ROBOT), urdf, folders) for c in needy}
    users = needy or list(description.components)
    if len(users) > 1:
        names = ", ".join(component.name for component in users)
        raise DescriptionError(
            f"{urdf} has several components with servos ({names}): instead of --robot, specify each robot "
            'file in its <hardware> as <param name="robot">'
        )
    return {users[0].name: robot}


def _found(name: str, urdf: Path, folders: Sequence[Path]) -> Path:
    """Return the path of a robot file, from the folder of the URDF, from ``folders`` or from the ``config`` folder.

    Raises RobotFileError if none of them contains the file.
    """
    places = list(dict.fromkeys((urdf.parent, *folders, CONFIG)))
    for place in places:
        if exists(place / name, RobotFileError):
            return place / name
    raise RobotFileError(
        f'{urdf}: <param name="robot"> is {name}, which is in none of the folders {", ".join(map(str, places))}: '
        "correct the name, or pass the file with --robot"
    )


def _robot(path: Path, description: Description, component: HardwareInfo) -> Robot:
    file = load_robot_file(path)
    try:
        return assemble(file, description, component)
    except RobotFileError as error:
        yaml = compose(path, RobotFileError)
        raise RobotFileError("\n".join(f"{_place(yaml, line)}: {line}" for line in str(error).splitlines())) from error


def _place(file: YamlFile, mistake: str) -> str:
    """Return the file and line to which an error message refers. The message must begin with a joint name or with the
    dotted keys of a value."""
    keys = mistake.split(maxsplit=1)[0].rstrip(":").split(".")
    return file.place(("joints", *keys) if keys[0] != "park" else keys)


@dataclass(frozen=True, slots=True)
class InitialStates:
    """Components that are not activated at startup, as set in the controllers file."""

    unconfigured: Collection[str]
    inactive: Collection[str]


def initial_states(files: Files) -> InitialStates:
    """Return ros2_control's parameter ``hardware_components_initial_state``. Raises ControllersFileError."""
    states = files.controllers.manager.get("hardware_components_initial_state") or {}
    where = f"{files.controllers.path}: hardware_components_initial_state"
    known = [component.name for component in files.description.components]
    lists: dict[str, list[str]] = {"unconfigured": [], "inactive": []}
    for state, names in states.items() if isinstance(states, Mapping) else [("", states)]:
        if state == "shutdown_on_initial_state_failure":
            LOG.warning("%s.%s has no effect: --stay decides whether the stack keeps running", where, state)
            continue
        if state not in lists or not isinstance(names, list):
            raise ControllersFileError(
                f"{where} must contain the lists unconfigured and inactive, not {state or states}"
            )
        if unknown := [str(name) for name in names if name not in known]:
            raise ControllersFileError(f"{where} lists {', '.join(unknown)}, but the URDF has {', '.join(known)}")
        lists[state] = names
    return InitialStates(**lists)


def servo_ids(files: ServoFiles, components: Collection[str] | None = None) -> dict[str, str]:
    """Return the servo address of each joint, for all components or for the given components."""
    driven = [c for c in files.description.components if components is None or c.name in components]
    return {
        joint.name: joint.address for joint in files.robot.joints if any(joint.name in one.joints for one in driven)
    }
