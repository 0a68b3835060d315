"""Where the arm's own files are, and how the three of them are read together."""

from dataclasses import dataclass
from pathlib import Path

from controller.controllers_file import ControllersFile, load_controllers_file
from hal.description import Component, Description, parse_urdf
from hal.errors import DescriptionError
from hal.robot import Robot, assemble, load_robot_file

HOME = Path(__file__).resolve().parent.parent
CONFIG = HOME / "config"
URDF = HOME / "urdf" / "robot_arm.urdf"
CONTROLLERS = CONFIG / "arm_controllers.yaml"


@dataclass(frozen=True, slots=True)
class Files:
    """What the three files say: URDF, robot file, controllers file."""

    description: Description
    component: Component
    robot: Robot
    controllers: ControllersFile
    urdf_path: Path
    robot_path: Path


def read_files(urdf: Path = URDF, controllers: Path = CONTROLLERS, robot: Path | None = None) -> Files:
    """Read and check all. ``robot`` is by default the file that the URDF's ``robot`` param names.

    Raises DescriptionError, RobotFileError or ControllersFileError; the text says what to mend.
    """
    description, component = read_description(urdf)
    robot_path = robot or _named_robot_file(component)
    robot_file = load_robot_file(robot_path)
    return Files(
        description,
        component,
        assemble(robot_file, description, component),
        load_controllers_file(controllers, robot_file.controller_defaults, component),
        urdf,
        robot_path,
    )


def read_description(urdf: Path) -> tuple[Description, Component]:
    """The URDF and its one hardware component."""
    try:
        description = parse_urdf(urdf.read_text())
    except OSError as error:
        raise DescriptionError(f"cannot read the URDF {urdf}: {error.strerror}") from error
    except DescriptionError as error:
        raise DescriptionError(f"{urdf}: {error}") from error
    if len(description.components) > 1:
        names = ", ".join(component.name for component in description.components)
        raise DescriptionError(f"{urdf} has several <ros2_control> blocks ({names}); one is driven")
    return description, description.components[0]


def _named_robot_file(component: Component) -> Path:
    return CONFIG / component.parameters.get("robot", "robot_arm.yaml")
