"""The calibration file: how one arm's servos are mounted. It lies beside the robot file, and goes before it."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from hal.errors import RobotFileError
from hal.plausible import Counts, NoTruth, ServoId
from hal.yaml_file import load


class CalibratedJoint(BaseModel):
    """One joint; counts are what its servo says with ``homing_offset``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    servo_id: ServoId
    sign: Annotated[Literal[1, -1], NoTruth]
    zero_counts: Counts = Field(ge=-32767, le=32767)
    homing_offset: Counts | None = None
    """What the servo's register held when the rest was measured; None: it has none that counts."""
    extended: bool = False
    """Whether a Dynamixel X was in extended position mode then, in which alone every homing offset counts."""
    lower_counts: Counts
    """The ends of the travel, by count."""
    upper_counts: Counts


class CalibrationFile(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    joints: dict[str, CalibratedJoint]


def calibration_path(robot: Path) -> Path:
    """The calibration file of a robot file: ``robot.yaml`` has ``robot.calibration.yaml``."""
    return robot.with_name(f"{robot.stem}.calibration.yaml")


def load_calibration(robot: Path) -> CalibrationFile | None:
    """Read the calibration of this robot file; None where there is none. Raises RobotFileError with every mistake."""
    path = calibration_path(robot)
    return load(path, CalibrationFile, RobotFileError) if path.exists() else None
