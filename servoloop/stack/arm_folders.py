"""The folder of an arm: ``config/arms/NAME/arm.yaml`` says what the arm is and where its files are."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, Field

from commissioning.calibrate.plan import ArmPlan
from hal.errors import ArmFileError
from hal.yaml_file import load
from hal.yaml_nodes import compose
from servoloop.stack.robot_files import CONFIG, Files, ServoFiles, read_servo_files, with_controllers

ARMS: Final = CONFIG / "arms"
ARM_FILE: Final = "arm.yaml"
PATHS: Final = ("urdf", "robot", "scene", "controllers", "pick_place")
OWN: Final = "robot_arm"
"""The arm where none is named."""


class ArmFile(BaseModel):
    """The whole file. Paths are relative to its folder."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    description: str = Field(pattern=r"^[^\n]+$")
    """What the arm is, in one line."""
    like: str | None = None
    """The folder of another arm: what this file does not say is as there."""
    urdf: str = "arm.urdf"
    robot: str = "robot.yaml"
    scene: str = "scene.xml"
    controllers: str = "controllers.yaml"
    pick_place: str = "pick_place.yaml"
    calibration: ArmPlan = ArmPlan()
    """How its servos are brought together with the URDF's angles."""
    source: str = ""
    """Where its description comes from, and what was changed."""
    license: str = ""
    """Of the description, as an SPDX identifier."""


@dataclass(frozen=True, slots=True)
class Arm:
    """An arm's folder."""

    name: str
    folder: Path
    file: ArmFile

    @property
    def urdf(self) -> Path:
        """The robot description, with its ``<ros2_control>`` block."""
        return self._path(self.file.urdf)

    @property
    def robot(self) -> Path:
        """The robot file."""
        return self._path(self.file.robot)

    @property
    def scene(self) -> Path:
        """The MuJoCo scene with the arm, the cube and the bins."""
        return self._path(self.file.scene)

    @property
    def controllers(self) -> Path:
        """The controllers file."""
        return self._path(self.file.controllers)

    @property
    def pick_place(self) -> Path:
        """The parameters of the pick-place node."""
        return self._path(self.file.pick_place)

    def _path(self, name: str) -> Path:
        return (self.folder / name).resolve()


def arms(folder: Path = ARMS) -> list[Arm]:
    """The arms that are ready, by name. Raises ArmFileError."""
    return [read_arm(path.parent) for path in sorted(folder.glob(f"*/{ARM_FILE}"))]


def find_arm(name: str = OWN) -> Arm:
    """The arm of this name, or in the folder of this path. Raises ArmFileError."""
    for folder in (Path(name),) if "/" in name else (ARMS / name, Path(name)):  # ./so101 is somebody's own
        if (folder / ARM_FILE).is_file():
            return read_arm(folder)
    known = ", ".join(path.parent.name for path in sorted(ARMS.glob(f"*/{ARM_FILE}")))
    raise ArmFileError(f"there is no arm {name}: name one of {known}, or a folder with {ARM_FILE}")


def arm_in(path: Path, name: str, number: int = 0) -> Arm:
    """The arm that the file at ``path`` names under ``arm``. Raises ArmFileError with file and line.

    ``number``: the arm's place if ``arm`` is a list.
    """
    try:
        return find_arm(name)
    except ArmFileError as error:
        raise ArmFileError(f"{compose(path, ArmFileError).place(('arm', number))}: {error}") from error


def read_arm(folder: Path) -> Arm:
    """Read ``arm.yaml`` of a folder, not yet the files that it names. Raises ArmFileError with every mistake."""
    home = folder.resolve()
    said = load(folder / ARM_FILE, ArmFile, ArmFileError)
    return Arm(home.name, home, said if said.like is None else _completed(said, home / said.like, folder / ARM_FILE))


def _completed(said: ArmFile, model: Path, where: Path) -> ArmFile:
    """What an arm's file says, and for the rest what that of the arm in ``model`` says."""
    other = load(model / ARM_FILE, ArmFile, ArmFileError)
    if other.like is not None:
        raise ArmFileError(f"{where}: like: {model.name} is itself like {other.like}: name that one")
    paths = {name: str((model / getattr(other, name)).resolve()) for name in PATHS}
    rest = {"source": other.source, "license": other.license, "calibration": other.calibration, **paths}
    return said.model_copy(update={name: value for name, value in rest.items() if name not in said.model_fields_set})


def read_arm_files(
    arm: Arm, urdf: Path | None = None, controllers: Path | None = None, robot: Path | None = None
) -> Files:
    """Read and check an arm's files; single files count more than the arm's. Raises as read_files does."""
    return with_controllers(read_arm_servos(arm, urdf, robot), controllers or arm.controllers)


def read_arm_servos(arm: Arm, urdf: Path | None = None, robot: Path | None = None) -> ServoFiles:
    """Read and check an arm's files without its controllers. Raises as read_servo_files does.

    With another URDF the robot file is the one that the URDF names, unless ``robot`` is given. The poses are in its
    folder, but those of the arm's own URDF, named or not, are in the arm's folder.
    """
    own = None if urdf else arm.robot
    servos = read_servo_files(urdf or arm.urdf, robot or own, arm.scene)
    poses = arm.folder if urdf is None or urdf.resolve() == arm.urdf else urdf.resolve().parent
    return replace(servos, arm=arm.name, arm_folder=arm.folder, folder=poses)
