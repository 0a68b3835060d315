"""The files of a robot (URDF, robot files, controllers file): where the arm's own are, and how they are read."""

import logging
import tempfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from commissioning.atomic_write import cannot_write, write_whole
from controller.manager.controllers_file import ControllersFile, ControllersFileError, load_controllers_file
from drivers.errors import DriverError
from hal.errors import DescriptionError, RobotFileError
from hal.robot_description.description import Description, merged, parse_urdf
from hal.robot_description.hardware_info import HardwareInfo
from hal.robot_file.robot import Robot, assemble
from hal.robot_file.robot_file import load_robot_file
from hal.robot_file.robots import all_limits, together
from hal.text_file import read_xml
from hal.types import JointLimits
from hal.yaml_nodes import YamlFile, compose

LOG = logging.getLogger("servoloop")

HOME = Path(__file__).resolve().parents[2]
CONFIG = HOME / "config"
URDF = HOME / "urdf" / "robot_arm.urdf"
CONTROLLERS = CONFIG / "arm_controllers.yaml"
SCENE = HOME / "urdf" / "scene.xml"
OWN_SERVOS = ("servoloop/ServoHardware", "servoloop/MujocoHardware")
"""The plug-ins that cannot do without a robot file."""
ROBOT = "robot_arm.yaml"


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoFiles:
    """The contents of the files that describe an arm and its servos: URDF and robot files."""

    description: Description
    component: HardwareInfo
    """All components as one."""
    robot: Robot
    """All servos; those of several components as one robot."""
    limits: dict[str, JointLimits]
    """Of every joint that takes commands."""
    urdf_path: Path
    robot_paths: dict[str, Path]
    """By component; one that needs no robot file has none."""
    scene: Path = SCENE
    """The simulated world."""
    arm: str = "robot_arm"
    """The arm's name, under which the running stack can be found."""
    folder: Path | None = None
    """The arm's own folder, where its poses are kept; None for files that belong to no arm."""
    arm_folder: Path = CONFIG / "arms" / "robot_arm"
    """The folder of the arm that the other files belong to."""

    @property
    def robot_path(self) -> Path:
        """The robot file of the first component that has one."""
        return next(iter(self.robot_paths.values()), CONFIG / ROBOT)

    @property
    def servo_options(self) -> tuple[str, ...]:
        """The options by which ``servoloop emulate`` in another process reads exactly these files.

        The robot files of several components are left to the URDF, which names them.
        """
        paths = {"arm": self.arm_folder, "urdf": self.urdf_path}
        if len(self.robot_paths) == 1:
            paths["robot"] = self.robot_path
        return _options(paths)


@dataclass(frozen=True, slots=True, kw_only=True)
class Files(ServoFiles):
    """The contents of all of an arm's files: those of its servos, and the controllers file."""

    controllers: ControllersFile

    @property
    def options(self) -> tuple[str, ...]:
        """The options by which ``servoloop up`` in another process reads exactly these files."""
        return (*self.servo_options, *_options({"controllers": self.controllers.path}))


def _options(paths: Mapping[str, Path]) -> tuple[str, ...]:
    return tuple(word for name, path in paths.items() for word in (f"--{name}", str(path.absolute())))


def read_files(
    urdf: Path = URDF, controllers: Path = CONTROLLERS, robot: Path | None = None, scene: Path = SCENE
) -> Files:
    """Read and check a robot's files. ``robot`` is by default the file that the URDF's ``robot`` param names.

    Raises DescriptionError, RobotFileError or ControllersFileError; the text says what to mend.
    """
    servos = read_servo_files(urdf, robot, scene)
    return with_controllers(servos, controllers)


def with_controllers(servos: ServoFiles, controllers: Path) -> Files:
    """Read the controllers file for these servos and check that it fits them. Raises ControllersFileError."""
    defaults = servos.robot.file.controller_defaults
    origin = compose(servos.robot_path, ControllersFileError) if defaults else None
    loaded = load_controllers_file(controllers, defaults, servos.component, origin)
    known = {one.name: getattr(servos, one.name) for one in fields(servos)}
    return Files(**known, controllers=loaded)


def read_servo_files(urdf: Path = URDF, robot: Path | None = None, scene: Path = SCENE) -> ServoFiles:
    """Read and check an arm's files without its controllers. Raises DescriptionError or RobotFileError."""
    description = read_description(urdf)
    for warning in description.warnings:
        LOG.warning("%s", warning)
    paths = _robot_paths(description, urdf, robot)
    parts = [(c, _robot(paths[c.name], description, c)) for c in description.components if c.name in paths]
    whole = together(parts)
    return ServoFiles(
        description=description,
        component=merged(description.components),
        robot=whole,
        limits=all_limits(description.components, whole, description.joints),
        urdf_path=urdf,
        robot_paths=paths,
        scene=scene,
    )


def read_description(urdf: Path) -> Description:
    """Read the URDF. Raises DescriptionError."""
    try:
        return parse_urdf(read_xml(urdf, DescriptionError, "the URDF"), str(urdf))
    except DescriptionError as error:
        named = str(urdf) in str(error)
        raise DescriptionError(str(error) if named else f"{urdf}: {error}") from error


def _robot_paths(description: Description, urdf: Path, said: Path | None) -> dict[str, Path]:
    """The robot file of each component that needs one: what the command line says, or its ``robot`` param."""
    needy = [c for c in description.components if "robot" in c.parameters or c.plugin in OWN_SERVOS]
    if said is None:
        return {c.name: _found(c.parameters.get("robot", ROBOT), urdf) for c in needy}
    asked = needy or list(description.components)
    if len(asked) > 1:
        names = ", ".join(component.name for component in asked)
        raise DescriptionError(
            f"{urdf} has several components with servos ({names}): instead of --robot, name each one's robot "
            'file in its <hardware> as <param name="robot">'
        )
    return {asked[0].name: said}


def _found(name: str, urdf: Path) -> Path:
    """The robot file's path: beside the URDF, or else among our own; an absolute path is both."""
    beside = urdf.parent / name
    return beside if beside.exists() else CONFIG / name


def _robot(path: Path, description: Description, component: HardwareInfo) -> Robot:
    file = load_robot_file(path)
    try:
        return assemble(file, description, component)
    except RobotFileError as error:
        yaml = compose(path, RobotFileError)
        raise RobotFileError("\n".join(f"{_place(yaml, line)}: {line}" for line in str(error).splitlines())) from error


def _place(file: YamlFile, mistake: str) -> str:
    """The file and the line of a mistake that begins with the name of a joint, or with the keys of a value."""
    keys = mistake.split(maxsplit=1)[0].rstrip(":").split(".")
    return file.place(("joints", *keys) if keys[0] != "park" else keys)


@dataclass(frozen=True, slots=True)
class InitialStates:
    """The components that do not become active at the start, by the controllers file."""

    unconfigured: Collection[str]
    inactive: Collection[str]


def initial_states(files: Files) -> InitialStates:
    """Upstream's ``hardware_components_initial_state`` of the manager. Raises ControllersFileError."""
    said = files.controllers.manager.get("hardware_components_initial_state") or {}
    where = f"{files.controllers.path}: hardware_components_initial_state"
    known = [component.name for component in files.description.components]
    lists: dict[str, list[str]] = {"unconfigured": [], "inactive": []}
    for state, names in said.items() if isinstance(said, Mapping) else [("", said)]:
        if state == "shutdown_on_initial_state_failure":
            LOG.warning("%s.%s has no effect: a component that fails is named, and keep-alive decides", where, state)
            continue
        if state not in lists or not isinstance(names, list):
            raise ControllersFileError(f"{where} has the lists unconfigured and inactive, not {state or said}")
        if strangers := [str(name) for name in names if name not in known]:
            raise ControllersFileError(f"{where} names {', '.join(strangers)}: the URDF has {', '.join(known)}")
        lists[state] = names
    return InitialStates(**lists)


def servo_ids(files: ServoFiles, components: Collection[str] | None = None) -> dict[str, str]:
    """The address of each joint's servo, by joint: of all components, or of those named."""
    driven = [c for c in files.description.components if components is None or c.name in components]
    return {
        joint.name: joint.address for joint in files.robot.joints if any(joint.name in one.joints for one in driven)
    }


def make_folder(folder: Path) -> None:
    """Make a folder for results, where there is none yet. Raises DriverError where nothing can be written into it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DriverError(f"cannot write into {folder}: {error.strerror}") from error
    require_writable(folder)


def require_file(path: Path) -> None:
    """Raise DriverError where no file can be written at ``path``: before a run, as the end of it is too late."""
    if path.is_dir():
        raise DriverError(f"{path} is a folder: name a file")
    if path.exists() and not path.is_file():
        raise DriverError(f"{path} is no file, and what is there would be replaced: name a file")
    require_writable(path.parent)


def write_file(path: Path, content: str | bytes, keep: bool = True) -> None:
    """Write a whole file; ``keep``: the former one stays, with .1 behind its name. Raises DriverError."""
    try:
        write_whole(path, content, keep)
    except OSError as error:
        raise DriverError(cannot_write(path, error)) from error


def require_writable(folder: Path) -> None:
    """Write into a folder now: the end of a run is too late to learn that it cannot be. Raises DriverError."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise DriverError(f"cannot write into {folder}: {error.strerror}") from error
