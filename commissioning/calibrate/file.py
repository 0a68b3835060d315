"""The calibration file beside the robot file: signs, zeros and homing offsets of one arm as it was put together."""

from collections.abc import Mapping
from pathlib import Path

import yaml

from commissioning.calibrate.result import CalibrationError, JointCalibration
from commissioning.whole_file import cannot_write, write_whole
from hal.robot_file.calibration_file import CalibratedJoint, CalibrationFile, calibration_path

HEADER = "# Written by servoloop calibrate. The former one is beside it, with .1 behind its name.\n"
UNFINISHED = "# Not in all servos: calibrate again. The last one that was is beside it, with .1 behind its name.\n"


def save(robot: Path, joints: Mapping[str, tuple[int, JointCalibration]], in_servos: bool = True) -> Path:
    """Write the calibration (servo ID and calibration by joint) of this robot file; the former one is kept.

    Written beside and renamed: whatever happens, there is a whole file. ``in_servos``: whether all servos have it. One
    of which the file says that they never had it all is not kept: it would take the place of the last good one. Raises
    CalibrationError, with a note of what was to be written.
    """
    path = calibration_path(robot)
    content = CalibrationFile(
        joints={
            name: CalibratedJoint(
                servo_id=servo_id,
                sign=1 if made.sign > 0 else -1,
                zero_counts=made.zero_counts,
                homing_offset=made.homing_offset,
                extended=made.extended,
                lower_counts=made.lower_counts,
                upper_counts=made.upper_counts,
            )
            for name, (servo_id, made) in joints.items()
        }
    )
    text = yaml.safe_dump(
        content.model_dump(exclude_defaults=True), sort_keys=False, default_flow_style=None, width=120
    )
    try:
        former_is_good = not (path.exists() and path.read_bytes().startswith(UNFINISHED.encode()))
        write_whole(path, (HEADER if in_servos else UNFINISHED) + text, keep=former_is_good)
    except OSError as error:
        failed = CalibrationError(cannot_write(path, error))
        failed.add_note(f"it was to hold:\n{text}")
        raise failed from error
    return path


def set_aside(robot: Path) -> str:
    """Take a calibration that proved wrong out of use, and restore the former one; returns a sentence about both.

    The servos keep the new homing offsets: the arm does not come up with a calibration that has others.
    """
    path = calibration_path(robot)
    wrong, former = path.with_name(path.name + ".wrong"), path.with_name(path.name + ".1")
    path.replace(wrong)
    text = f"it is in {wrong} now, and not in use"
    if former.exists():
        former.replace(path)
        text += f"; {path} is the former one again"
    return text + ". Calibrate again"
