"""Read the calibration file, which describes how the servos of one arm are mounted and overrides the robot file."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from hal.hal_errors import RobotFileError
from hal.plausible import Counts, NoTruth, ServoId
from hal.text_file import exists
from hal.yaml_file import load


class CalibratedJoint(BaseModel):
    """Calibration of one joint. All counts are readings of the servo with this ``homing_offset``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    servo_id: ServoId
    sign: Annotated[Literal[1, -1], NoTruth]
    zero_counts: Counts = Field(ge=-32767, le=32767)
    homing_offset: Counts | None = None
    """Homing offset of the servo during calibration; None if the servo has no effective homing offset."""
    extended: bool = False
    """Whether the servo, a Dynamixel X, was in extended position mode. Large homing offsets take effect only in this
    mode.
    """
    lower_counts: Counts
    """Lowest count of the travel."""
    upper_counts: Counts
    """Highest count of the travel."""

    def crosses_seam(self, last_count: int) -> bool:
        """Return whether the travel contains the seam, where the reading jumps from ``last_count`` to 0."""
        return not 0 <= self.lower_counts < self.upper_counts <= last_count


class CalibrationFile(BaseModel):
    """Content of the calibration file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    joints: dict[str, CalibratedJoint]


def calibration_path(robot: Path) -> Path:
    """Return the path of the calibration file for a robot file: ``robot.calibration.yaml`` for ``robot.yaml``."""
    return robot.with_name(f"{robot.stem}.calibration.yaml")


def load_calibration(robot: Path) -> CalibrationFile | None:
    """Read the calibration for a robot file, or return None if there is none.

    Raises one RobotFileError that lists all errors.
    """
    path = calibration_path(robot)
    return load(path, CalibrationFile, RobotFileError) if exists(path, RobotFileError) else None
