"""LeRobot's calibration file (JSON) becomes ours, and ours becomes LeRobot's, without loss.

Both name a servo's ID, its homing offset and the ends of its travel in counts. Two things differ:

- LeRobot knows no direction of the URDF's. The robot file's ``sign`` says how such arms are built; ``drive_mode`` 1
  says that this servo turns the other way.
- LeRobot's zero is the pose that was held when Enter was pressed, at count 2047. It is not the URDF's: see
  ``commissioning.lerobot_import``.
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from calibration.angles import LARGEST_OFFSET
from commissioning.calibrate.result import CalibrationError
from hal.plausible import Counts, NoTruth, ServoId
from hal.robot_file.calibration_file import CalibratedJoint, CalibrationFile
from hal.text_file import read_text
from hal.yaml_file import error_text
from hal.yaml_nodes import compose, listed

LEROBOT_ZERO_COUNTS: Final = 2047
"""LeRobot's middle of a turn: what a servo says in the pose that was held when Enter was pressed."""
ITS_ZERO: Final = (
    "LeRobot's zero is not the URDF's: it is the pose in which the arm was held when Enter was pressed (count "
    f"{LEROBOT_ZERO_COUNTS})"
)
OLD_KEYS: Final = {"motor_names", "start_pos", "end_pos", "calib_mode"}
"""Of LeRobot's files before each joint had an entry of its own."""


class LerobotJoint(BaseModel):
    """One joint of LeRobot's file, in LeRobot's order."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    id: ServoId
    drive_mode: Annotated[Literal[0, 1], NoTruth]
    homing_offset: Counts
    range_min: Counts
    range_max: Counts


LerobotFile = dict[str, LerobotJoint]
_FILE: Final = TypeAdapter(LerobotFile)


def read_lerobot(path: Path) -> LerobotFile:
    """Read LeRobot's file. Raises CalibrationError with every mistake."""
    try:
        content = json.loads(read_text(path, CalibrationError), object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:  # JSON's errors too, and brackets without end
        raise CalibrationError(f"{path} is no JSON file of LeRobot's: {error}") from error
    if isinstance(content, dict) and OLD_KEYS & content.keys():
        raise CalibrationError(f"{path} is of an older LeRobot, whose offsets are none of the servos': calibrate anew")
    try:
        return _FILE.validate_python(content)
    except ValidationError as error:
        place = places(path)
        lines = [
            f"{place(item['loc'])}: {'.'.join(map(str, item['loc']))}: {error_text(item)}" for item in error.errors()
        ]
        raise CalibrationError("\n".join(listed(lines))) from error


def places(path: Path) -> Callable[[Sequence[int | str]], str]:
    """Where values of a JSON file are: file and line, as far as it is YAML too, which most JSON is."""
    try:
        return compose(path, CalibrationError).place
    except CalibrationError:
        return lambda location: str(path)


def without_prefix(file: LerobotFile, prefix: str) -> LerobotFile:
    """The entries whose names begin with this prefix, without it. Raises CalibrationError if there are none."""
    found = {name.removeprefix(prefix): one for name, one in file.items() if name.startswith(prefix)}
    if not found:
        raise CalibrationError(f"no joint in LeRobot's file begins with {prefix}: it has {', '.join(file) or 'none'}")
    return found


def prefix_of(file: LerobotFile, joints: Sequence[str]) -> str:
    """The prefix with which the file names all of these joints; empty if there is none."""
    prefixes = (name.removesuffix(joints[0]) for name in file if name.endswith(joints[0])) if joints else ()
    return next((prefix for prefix in prefixes if all(prefix + joint in file for joint in joints)), "")


def lerobot_text(file: LerobotFile) -> str:
    """The file as LeRobot writes it."""
    return json.dumps({name: joint.model_dump() for name, joint in file.items()}, indent=4)


def to_lerobot(calibration: CalibrationFile, built: Mapping[str, int]) -> LerobotFile:
    """LeRobot's file of our calibration. Raises CalibrationError with all that LeRobot has no place for."""
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
    """LeRobot's entry of one joint, which such arms have with the sign ``built``; None without a homing offset that
    servos take.
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
        return f"its servo ({ours.servo_id}) has no homing offset: LeRobot's file has no place for it"
    return (
        f"the homing offset {ours.homing_offset} is none that its servo ({ours.servo_id}) takes, {-LARGEST_OFFSET} to "
        f"{LARGEST_OFFSET}: calibrate anew"
    )


def entry_mistakes(theirs: LerobotJoint, last: int = 4095) -> list[str]:
    """What cannot be right about the offset and the travel of a servo with the counts 0 to ``last``."""
    low, high = theirs.range_min, theirs.range_max
    if abs(theirs.homing_offset) > LARGEST_OFFSET:
        return [
            f"its homing offset {theirs.homing_offset} is none that its servo ({theirs.id}) takes, "
            f"{-LARGEST_OFFSET} to {LARGEST_OFFSET}: calibrate anew"
        ]
    if not (0 <= low <= last and 0 <= high <= last):
        return [f"its range {low} to {high} is not within the servo's counts, 0 to {last}: calibrate anew"]
    if low == high:
        return [f"its range begins and ends at {low}: the joint was not moved. Calibrate anew, from stop to stop"]
    if low > high:
        return [
            f"its range begins at {low} and ends at {high}: it goes over the seam, where the counts begin anew. "
            "servoloop calibrate puts the seam outside the travel"
        ]
    return []


def _once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON whose keys are all different."""
    found = dict(pairs)
    if len(found) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        raise ValueError(f"{', '.join(sorted(n for n, count in counts.items() if count > 1))} stands there twice")
    return found
