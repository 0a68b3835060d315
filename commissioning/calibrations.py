"""Import, export and list an arm's calibration from scripts. Calibrations are imported from and exported to LeRobot's
calibration file format."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from commissioning.atomic_write import write_whole
from commissioning.calibrate.plan import JointPlan
from commissioning.calibrate.result import JointCalibration, travel_warnings
from commissioning.calibrate.store import save
from commissioning.commissioning_errors import CalibrationError
from commissioning.lerobot import lerobot_text, places, read_lerobot, to_lerobot, without_prefix
from commissioning.lerobot_import import Imported, from_lerobot, require_offsets
from hal.hal_errors import RobotFileError
from hal.joint import Joint
from hal.robot_file.calibration_file import calibration_path, load_calibration
from hal.robot_file.robot_file import RobotFile
from hal.yaml_file import load


@dataclass(frozen=True, slots=True)
class CalibrationRow:
    """Calibration of one joint, as shown to the user in the table. Positions are in rad (m for a prismatic joint)."""

    joint: str
    servo_id: int
    sign: int
    zero_counts: int
    homing_offset: int | None
    travel: float | None
    """Distance from stop to stop; None if it has never been measured."""
    urdf_range: float
    doubt: str
    """Warnings about implausible values; empty if all values are plausible."""


def import_calibration(
    lerobot: Path, robot: Path, joints: Sequence[Joint], plans: Mapping[str, JointPlan], prefix: str = ""
) -> tuple[list[Imported], Path]:
    """Import LeRobot's calibration for this robot file. Return the imported joints and the path of the new file.

    Args:
        lerobot: LeRobot's calibration file.
        robot: Robot file of the arm.
        joints: Joints of the arm.
        plans: Calibration plan of each joint, keyed by joint name.
        prefix: Prefix of this arm's joint names in LeRobot's file. Entries without this prefix are ignored.

    Raises:
        CalibrationError: The file contains errors. The message lists all of them, and no file is written.
    """
    require_offsets(joints)
    file = without_prefix(read_lerobot(lerobot), prefix)
    with _placed(places(lerobot), {name: (f"{prefix}{name}",) for name in file}):
        made = from_lerobot(file, joints, built_signs(robot), plans, load_calibration(robot))
    return made, save(robot, {one.joint.name: (one.joint.servo_id, one.made) for one in made})


def export_calibration(lerobot: Path, robot: Path) -> None:
    """Export the calibration of this robot file in LeRobot's format, and keep the previous file.

    Raises CalibrationError.
    """
    calibration = load_calibration(robot)
    if calibration is None:
        raise CalibrationError(f"{calibration_path(robot)} does not exist: calibrate first with servoloop calibrate")
    with _placed(places(calibration_path(robot)), {name: ("joints", name) for name in calibration.joints}):
        text = lerobot_text(to_lerobot(calibration, built_signs(robot)))
    try:
        write_whole(lerobot, text)
    except OSError as error:
        raise CalibrationError(f"cannot write {lerobot}: {error.strerror}") from error


@contextmanager
def _placed(place: Callable[[Sequence[str]], str], known: Mapping[str, Sequence[str]]) -> Iterator[None]:
    """Add the file and line to messages that begin with a joint name. ``known`` holds the location of each joint."""
    try:
        yield
    except CalibrationError as error:
        lines = [(line, known.get(line.partition(":")[0])) for line in str(error).splitlines()]
        placed = [line if location is None else f"{place(location)}: {line}" for line, location in lines]
        raise CalibrationError("\n".join(placed)) from error


def built_signs(robot: Path) -> dict[str, int]:
    """Return the sign of each joint from the robot file itself, without the calibration.

    These signs apply to all arms of the same design.
    """
    return {name: joint.sign for name, joint in load(robot, RobotFile, RobotFileError).joints.items()}


def calibration_rows(robot: Path, joints: Sequence[Joint]) -> list[CalibrationRow]:
    """Return the calibration of each joint for display. The travel is known only from a calibration file."""
    calibration = load_calibration(robot)
    rows: list[CalibrationRow] = []
    for joint in joints:
        said = calibration.joints.get(joint.name) if calibration else None
        made = said and JointCalibration(
            said.sign, said.zero_counts, said.homing_offset, said.lower_counts, said.upper_counts
        )
        travel, doubt = (made.travel(joint), travel_warnings(joint, made)) if made else (None, "not calibrated yet")
        range_ = joint.limits.upper - joint.limits.lower
        rows.append(
            CalibrationRow(
                joint.name, joint.servo_id, joint.sign, joint.zero_counts, joint.homing_offset, travel, range_, doubt
            )
        )
    return rows
