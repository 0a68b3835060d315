"""The calibration file beside the robot file: signs, zeros and homing offsets of one arm as it was put together."""

from collections.abc import Mapping
from pathlib import Path

import yaml

from commissioning.calibrate.result import CalibrationError, JointCalibration
from commissioning.whole_file import write_whole
from hal.robot_file.calibration_file import CalibratedJoint, CalibrationFile, calibration_path

HEADER = "# Written by servoloop calibrate. The former one is beside it, with .1 behind its name.\n"


def save(robot: Path, joints: Mapping[str, tuple[int, JointCalibration]]) -> Path:
    """Write the calibration (servo ID and calibration by joint) of this robot file; the former one is kept.

    Written beside and renamed: whatever happens, there is a whole file. Raises CalibrationError.
    """
    path = calibration_path(robot)
    content = CalibrationFile(
        joints={
            name: CalibratedJoint(
                servo_id=servo_id,
                sign=1 if made.sign > 0 else -1,
                zero_counts=made.zero_counts,
                homing_offset=made.homing_offset,
                lower_counts=made.lower_counts,
                upper_counts=made.upper_counts,
            )
            for name, (servo_id, made) in joints.items()
        }
    )
    text = HEADER + yaml.safe_dump(content.model_dump(), sort_keys=False, default_flow_style=None, width=120)
    try:
        write_whole(path, text)
    except OSError as error:
        raise CalibrationError(f"cannot write {path}: {error.strerror}: the former one is there still") from error
    return path
