"""Find and read arm folders. ``config/arms/NAME/arm.yaml`` describes an arm and lists its files."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, Field

from commissioning.calibrate.plan import ArmPlan
from drivers.paths import resolved
from hal.hal_errors import ArmFileError
from hal.text_file import exists
from hal.yaml_file import load
from hal.yaml_nodes import compose
from servoloop.stack.robot_files import NO_ARGUMENTS, Files, ServoFiles, read_servo_files, with_controllers
from servoloop.stack.shipped_files import ARM_FILE, ARMS, OWN

PATHS: Final = ("urdf", "robot", "scene", "controllers", "pick_place", "pick_place_poses")


class ArmFile(BaseModel):
    """Contents of ``arm.yaml``. Paths are relative to the folder that contains this file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    description: str = Field(pattern=r"^[^\n]+$")
    """One-line description of the arm."""
    like: str | None = None
    """Folder of another arm that supplies every value missing from this file."""
    urdf: str = "arm.urdf"
    robot: str = "robot.yaml"
    scene: str = "scene.xml"
    controllers: str = "controllers.yaml"
    pick_place: str = "pick_place.yaml"
    pick_place_poses: str = "pick_place_poses.yaml"
    calibration: ArmPlan = ArmPlan()
    """Plan for calibrating the servos to the joint angles of the URDF."""
    source: str = ""
    """Origin of the robot description, and changes made to it."""
    license: str = ""
    """License of the robot description, as an SPDX identifier."""


@dataclass(frozen=True, slots=True)
class ArmFolder:
    """Folder of an arm, with the contents of its ``arm.yaml``."""

    name: str
    folder: Path
    file: ArmFile

    @property
    def urdf(self) -> Path:
        """Path of the robot description with its ``<ros2_control>`` block."""
        return self._path(self.file.urdf)

    @property
    def robot(self) -> Path:
        """Path of the robot file."""
        return self._path(self.file.robot)

    @property
    def scene(self) -> Path:
        """Path of the MuJoCo scene with the arm, the cube and the bins."""
        return self._path(self.file.scene)

    @property
    def controllers(self) -> Path:
        """Path of the controllers file."""
        return self._path(self.file.controllers)

    @property
    def pick_place(self) -> Path:
        """Path of the pick-place node's parameter file."""
        return self._path(self.file.pick_place)

    @property
    def pick_place_poses(self) -> Path:
        """Path of the pick-place node's parameter file for planned motions to poses. Not every arm has this file."""
        return self._path(self.file.pick_place_poses)

    def _path(self, name: str) -> Path:
        return resolved(self.folder / name)


def arms(folder: Path = ARMS) -> list[ArmFolder]:
    """Read the ``arm.yaml`` of every arm in ``folder``, sorted by name. Raises ArmFileError."""
    return [read_arm(path.parent) for path in sorted(folder.glob(f"*/{ARM_FILE}"))]


def find_arm(name: str = OWN) -> ArmFolder:
    """Return the arm with this name, or the arm in the folder at this path. Raises ArmFileError."""
    # A name that contains a slash, such as ./so101, is the path of a user's own folder.
    for folder in (Path(name),) if "/" in name else (ARMS / name, Path(name)):
        if exists(folder / ARM_FILE, ArmFileError):
            return read_arm(folder)
    known = ", ".join(path.parent.name for path in sorted(ARMS.glob(f"*/{ARM_FILE}")))
    raise ArmFileError(f"there is no arm {name}: choose one of {known}, or specify a folder with {ARM_FILE}")


def arm_in(path: Path, name: str, place: tuple[str, int] = ("arm", 0)) -> ArmFolder:
    """Return an arm that the file at ``path`` specifies.

    Args:
        path: Path of the file, for error messages.
        name: Name of the arm.
        place: Key of the arm in the file, and the index of the arm if the key is a list.

    Raises:
        ArmFileError: The arm does not exist. The message names the file and the line.
    """
    try:
        return find_arm(name)
    except ArmFileError as error:
        raise ArmFileError(f"{compose(path, ArmFileError).place(place)}: {error}") from error


def read_arm(folder: Path) -> ArmFolder:
    """Read ``arm.yaml`` of a folder, but not the files that it lists.

    Raises:
        ArmFileError: The file has errors. The message lists all of them.
    """
    home = resolved(folder)
    own = load(folder / ARM_FILE, ArmFile, ArmFileError)
    return ArmFolder(home.name, home, own if own.like is None else _completed(own, home / own.like, folder / ARM_FILE))


def _completed(own: ArmFile, model: Path, path: Path) -> ArmFile:
    """Return the arm file with its missing values copied from the arm in the folder ``model``."""
    other = load(model / ARM_FILE, ArmFile, ArmFileError)
    if other.like is not None:
        raise ArmFileError(
            f"{path}: `like` refers to {model.name}, which itself copies {other.like}: specify {other.like} instead"
        )
    paths = {name: str(resolved(model / getattr(other, name))) for name in PATHS}
    rest = {"source": other.source, "license": other.license, "calibration": other.calibration, **paths}
    return own.model_copy(update={name: value for name, value in rest.items() if name not in own.model_fields_set})


def read_arm_files(
    arm: ArmFolder,
    urdf: Path | None = None,
    controllers: Path | None = None,
    robot: Path | None = None,
    xacro_arguments: Mapping[str, str] = NO_ARGUMENTS,
    namespace: str = "",
) -> Files:
    """Read and check the files of an arm for a stack in a namespace.

    A file given as an argument replaces the file of the arm.

    Raises the same errors as read_files.
    """
    servos = read_arm_servos(arm, urdf, robot, xacro_arguments)
    return with_controllers(servos, controllers or arm.controllers, namespace)


def read_arm_servos(
    arm: ArmFolder,
    urdf: Path | None = None,
    robot: Path | None = None,
    xacro_arguments: Mapping[str, str] = NO_ARGUMENTS,
) -> ServoFiles:
    """Read and check the files of an arm, except for its controllers file.

    If ``urdf`` is given without ``robot``, the URDF specifies the robot file, which is next to ``urdf`` or in the arm's
    folder. If ``urdf`` is not the arm's own URDF,
    poses are read from the folder of ``urdf``. Raises the same errors as read_servo_files.
    """
    own = None if urdf else arm.robot
    servos = read_servo_files(urdf or arm.urdf, robot or own, arm.scene, xacro_arguments, (arm.folder, arm.urdf.parent))
    poses = arm.folder if urdf is None or resolved(urdf) == arm.urdf else resolved(urdf).parent
    return replace(servos, arm=arm.name, arm_folder=arm.folder, folder=poses)
