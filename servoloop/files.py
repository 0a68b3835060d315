"""Where the arm's own files are, and how they are read together."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

from controller.controllers_file import ControllersFile, load_controllers_file
from drivers.errors import DriverError
from hal.component import Component
from hal.description import Description, merged, parse_urdf
from hal.errors import DescriptionError, RobotFileError
from hal.robot import Robot, assemble, load_robot_file
from hal.robots import all_limits, together
from hal.types import JointLimits

HOME = Path(__file__).resolve().parent.parent
CONFIG = HOME / "config"
URDF = HOME / "urdf" / "robot_arm.urdf"
CONTROLLERS = CONFIG / "arm_controllers.yaml"
OWN_SERVOS = ("servoloop/ServoHardware", "servoloop/MujocoHardware")
"""The plug-ins that cannot do without a robot file."""
ROBOT = "robot_arm.yaml"


@dataclass(frozen=True, slots=True)
class Files:
    """What the files say: URDF, robot files, controllers file."""

    description: Description
    component: Component
    """All components as one."""
    robot: Robot
    """All servos; those of several components as one robot."""
    limits: dict[str, JointLimits]
    """Of every joint that takes commands."""
    controllers: ControllersFile
    urdf_path: Path
    robot_paths: dict[str, Path]
    """By component; one that needs no robot file has none."""

    @property
    def robot_path(self) -> Path:
        """That of the first component with one."""
        return next(iter(self.robot_paths.values()), CONFIG / ROBOT)


def read_files(urdf: Path = URDF, controllers: Path = CONTROLLERS, robot: Path | None = None) -> Files:
    """Read and check all. ``robot`` is by default the file that the URDF's ``robot`` param names.

    Raises DescriptionError, RobotFileError or ControllersFileError; the text says what to mend.
    """
    description = read_description(urdf)
    paths = _robot_paths(description, urdf, robot)
    parts = [(c, _robot(paths[c.name], description, c)) for c in description.components if c.name in paths]
    whole = together(parts)
    component = merged(description.components)
    return Files(
        description,
        component,
        whole,
        all_limits(description.components, whole, description.joints),
        load_controllers_file(controllers, whole.file.controller_defaults, component),
        urdf,
        paths,
    )


def read_description(urdf: Path) -> Description:
    """The URDF. Raises DescriptionError."""
    try:
        return parse_urdf(urdf.read_text())
    except OSError as error:
        raise DescriptionError(f"cannot read the URDF {urdf}: {error.strerror}") from error
    except DescriptionError as error:
        raise DescriptionError(f"{urdf}: {error}") from error


def _robot_paths(description: Description, urdf: Path, said: Path | None) -> dict[str, Path]:
    """By component: what the command line says, or its ``robot`` param; a mock, for one, needs none."""
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
    """Beside the URDF, or else among our own; an absolute path is both."""
    beside = urdf.parent / name
    return beside if beside.exists() else CONFIG / name


def _robot(path: Path, description: Description, component: Component) -> Robot:
    file = load_robot_file(path)
    try:
        return assemble(file, description, component)
    except RobotFileError as error:
        raise RobotFileError("\n".join(f"{path}: {line}" for line in str(error).splitlines())) from error


def make_folder(folder: Path) -> None:
    """For results, where it is not there yet. Raises DriverError where nothing can be written into it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DriverError(f"cannot write into {folder}: {error.strerror}") from error
    require_writable(folder)


def require_writable(folder: Path) -> None:
    """Try it now: to learn at the end of a run that its results have no place is too late. Raises DriverError."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise DriverError(f"cannot write into {folder}: {error.strerror}") from error
