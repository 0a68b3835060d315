"""Convert LeRobot's calibration file (JSON) to servoloop's format and back without loss.

Both files contain the ID, the homing offset and the ends of the travel of each servo, in counts. The two formats differ
in two ways:

- LeRobot's file does not specify the positive direction of the URDF. The robot file contains the ``sign`` of all arms
  of the same design, and ``drive_mode`` 1 means that this servo turns the other way.
- LeRobot's zero is the pose in which the user pressed Enter, at count 2047. This pose is not the zero of the URDF: see
  ``commissioning.lerobot_import``.
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from commissioning.commissioning_errors import CalibrationError
from drivers.servos.angles import LARGEST_OFFSET
from hal.plausible import Counts, NoTruth, ServoId
from hal.robot_file.calibration_file import CalibratedJoint, CalibrationFile
from hal.text_file import read_text
from hal.yaml_file import named_text
from hal.yaml_nodes import compose, listed

LEROBOT_ZERO_COUNTS: Final = 2047
"""Count of every servo in the pose in which the LeRobot user pressed Enter: the middle of the turn."""
ITS_ZERO: Final = (
    "LeRobot's zero differs from the zero of the URDF: it is the pose in which the user pressed Enter (count "
    f"{LEROBOT_ZERO_COUNTS})"
)
OLD_KEYS: Final = {"motor_names", "start_pos", "end_pos", "calib_mode"}
"""Keys of LeRobot's previous file format, which has no entry per joint."""


class LerobotJoint(BaseModel):
    """Entry for one joint in LeRobot's file, with the keys in LeRobot's order."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    id: ServoId
    drive_mode: Annotated[Literal[0, 1], NoTruth]
    homing_offset: Counts
    range_min: Counts
    range_max: Counts


LerobotFile = dict[str, LerobotJoint]
_FILE: Final = TypeAdapter(LerobotFile)


def read_lerobot(path: Path) -> LerobotFile:
    """Read LeRobot's file. Raises CalibrationError listing all errors."""
    try:
        content = json.loads(read_text(path, CalibrationError), object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:  # Brackets that are nested too deeply cause a RecursionError.
        raise CalibrationError(f"{path} is not a JSON file from LeRobot: {error}") from error
    if isinstance(content, dict) and OLD_KEYS & content.keys():
        raise CalibrationError(
            f"{path} is from an older version of LeRobot. Its offsets differ from those in the servos, so the file "
            "cannot be used: calibrate again"
        )
    try:
        return _FILE.validate_python(content)
    except ValidationError as error:
        place = places(path)
        lines = [f"{place(item['loc'])}: {named_text(item)}" for item in error.errors()]
        raise CalibrationError("\n".join(listed(lines))) from error


def places(path: Path) -> Callable[[Sequence[int | str]], str]:
    """Return a function that maps a location in a JSON file to the file and line, for use in messages.

    The function parses the JSON as YAML. If parsing fails, the function returns only the file name.
    """
    try:
        return compose(path, CalibrationError).place
    except CalibrationError:
        return lambda location: str(path)


def without_prefix(file: LerobotFile, prefix: str) -> LerobotFile:
    """Return the entries whose names begin with a prefix, without this prefix.

    Raises CalibrationError if there are no such entries.
    """
    found = {name.removeprefix(prefix): one for name, one in file.items() if name.startswith(prefix)}
    if not found:
        raise CalibrationError(
            f"no joint name in LeRobot's file begins with {prefix}. The joints in the file: {', '.join(file) or 'none'}"
        )
    return found


def prefix_of(file: LerobotFile, joints: Sequence[str]) -> str:
    """Return the prefix that all of these joints have in the file; an empty string if there is none."""
    prefixes = (name.removesuffix(joints[0]) for name in file if name.endswith(joints[0])) if joints else ()
    return next((prefix for prefix in prefixes if all(prefix + joint in file for joint in joints)), "")


def lerobot_text(file: LerobotFile) -> str:
    """Return the file contents in LeRobot's layout."""
    return json.dumps({name: joint.model_dump() for name, joint in file.items()}, indent=4)


def to_lerobot(calibration: CalibrationFile, built: Mapping[str, int]) -> LerobotFile:
    """Convert a calibration to LeRobot's format.

    Raises CalibrationError listing all values that the format cannot represent.
    """
    file: LerobotFile = {}
    problems: list[str] = []
    for name, ours in calibration.joints.items():
        theirs = entry_of(ours, built[name])
        if theirs is None:
            problems.append(f"{name}: {_no_place(ours)}")
        else:
            problems += [f"{name}: {mistake}" for mistake in entry_mistakes(theirs)]
            file[name] = theirs
    if problems:
        raise CalibrationError("\n".join(problems))
    return file


def entry_of(ours: CalibratedJoint, built: int) -> LerobotJoint | None:
    """Return LeRobot's entry for one joint, or None if the joint has no homing offset that servos accept.

    ``built`` is the sign of this joint in all arms of the same design.
    """
    if ours.homing_offset is None or abs(ours.homing_offset) > LARGEST_OFFSET:
        return None
    return LerobotJoint(
        id=ours.servo_id,
        drive_mode=0 if ours.sign == built else 1,
        homing_offset=ours.homing_offset,
        range_min=ours.lower_counts,
        range_max=ours.upper_counts,
    )


def _no_place(ours: CalibratedJoint) -> str:
    if ours.homing_offset is None:
        return f"its servo ({ours.servo_id}) has no homing offset, which LeRobot's file requires"
    return (
        f"the homing offset of its servo ({ours.servo_id}) must be {-LARGEST_OFFSET} to {LARGEST_OFFSET}, "
        f"not {ours.homing_offset}: calibrate again"
    )


def entry_mistakes(theirs: LerobotJoint, last: int = 4095) -> list[str]:
    """Return the errors in the offset and the travel of a servo whose counts range from 0 to ``last``."""
    low, high = theirs.range_min, theirs.range_max
    if abs(theirs.homing_offset) > LARGEST_OFFSET:
        return [
            f"the homing offset of its servo ({theirs.id}) must be {-LARGEST_OFFSET} to {LARGEST_OFFSET}, "
            f"not {theirs.homing_offset}: calibrate again"
        ]
    if not (0 <= low <= last and 0 <= high <= last):
        return [f"its range must be within 0 to {last} counts, not {low} to {high}: calibrate again"]
    if low == high:
        return [f"its range begins and ends at {low}: the joint was not moved. Calibrate again, from stop to stop"]
    if low > high:
        return [
            f"its range begins at {low} and ends at {high}, so it crosses the seam, where the count jumps from {last} "
            "to 0. Calibrate with servoloop calibrate, which moves the seam out of the travel"
        ]
    return []


def _once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object as a dictionary. Raises ValueError if a key occurs more than once."""
    found = dict(pairs)
    if len(found) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        raise ValueError(f"duplicate key: {', '.join(sorted(n for n, count in counts.items() if count > 1))}")
    return found
