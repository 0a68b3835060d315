"""Store a calibration: write the file, then write the homing offsets to the servos, then restart the servos."""

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import yaml

from commissioning.atomic_write import cannot_write, write_whole
from commissioning.calibrate.result import JointCalibration
from commissioning.calibrate.seam import can_move_seam, write_counting
from commissioning.commissioning_errors import CalibrationError
from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS, retry
from drivers.clock import Clock
from drivers.driver_errors import ServoError
from drivers.eeprom import Change
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from drivers.types import Reading, ServoState
from hal.joint import Joint
from hal.robot_file.calibration_file import CalibratedJoint, CalibrationFile, calibration_path, load_calibration

HEADER = "# Written by servoloop calibrate. The previous calibration is in the file with the suffix .1.\n"
UNFINISHED = (
    "# This calibration did not reach all servos: calibrate again. The last complete calibration is in the file "
    "with the suffix .1.\n"
)


def save(
    robot: Path,
    joints: Mapping[str, tuple[int, JointCalibration]],
    in_servos: bool = True,
    kept: Collection[str] = (),
) -> Path:
    """Write the calibration of this robot file, keep the previous calibration, and return the path.

    The file is written under a temporary name and then renamed, so it is complete at all times. An unfinished previous
    calibration is not kept, because it would overwrite the last complete calibration. If writing fails, the
    CalibrationError contains the content in a note.

    Args:
        robot: Robot file of the arm.
        joints: Servo ID and calibration of each joint, keyed by joint name.
        in_servos: Whether all servos already contain this calibration.
        kept: Other joints, whose previous calibration is kept.
    """
    path = calibration_path(robot)
    former = load_calibration(robot) if kept else None
    content = CalibrationFile(
        joints={
            **{name: one for name, one in (former.joints if former else {}).items() if name in kept},
            **{
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
            },
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
        failed.add_note(f"the file should have contained:\n{text}")
        raise failed from error
    return path


def set_aside(robot: Path) -> str:
    """Rename a calibration that proved to be wrong, restore the previous one, and return a message about both.

    The servos keep the new homing offsets. The arm refuses to start with a calibration whose offsets differ from those
    in the servos.
    """
    path = calibration_path(robot)
    wrong, former = path.with_name(path.name + ".wrong"), path.with_name(path.name + ".1")
    path.replace(wrong)
    text = f"the new calibration was moved to {wrong} and is not used"
    if former.exists():
        former.replace(path)
        text += f"; {path} is the previous calibration again"
    return text + ". Calibrate again"


RESTART_S: Final = 1.5
"""Time allowed for the restart of a servo, in seconds. A servo needs 0.8 s."""
AGAIN_S: Final = 0.1
"""Delay before another read from a silent servo, in seconds."""
SLACK_COUNTS: Final = 40
"""Tolerance of the travel, in counts. A stop gives way slightly, and a limp joint can move."""


def store(
    robot: Path,
    bus: Bus,
    joints: Sequence[Joint],
    made: Mapping[str, JointCalibration],
    clock: Clock,
    kept: Collection[str] = (),
) -> dict[str, tuple[Change, ...]]:
    """Write the calibration file and the homing offsets.

    Return the changes in the servos, keyed by joint name. Torque must be off. The joints in ``kept`` keep their
    previous calibration. The file is written first. If some servos cannot be written afterward, their offsets differ
    from the file, and the arm refuses to start. Raises CalibrationError, ServoError or PortLost, with a note about the
    values already stored.
    """
    content = {joint.name: (joint.servo_id, made[joint.name]) for joint in joints}
    path = save(robot, content, in_servos=False, kept=kept)
    changes: dict[str, tuple[Change, ...]] = {}
    try:
        for joint in joints:
            changes[joint.name] = write_counting(bus, joint, made[joint.name].counting)
        restart(bus, joints, clock)
        _check(joints, _readings(bus, joints, clock), made)
        save(robot, content, kept=kept)
    except BaseException as error:
        error.add_note(_half_stored(path, list(changes), [j.name for j in joints if j.name not in changes]))
        raise
    return changes


def _half_stored(path: Path, written: Sequence[str], left: Sequence[str]) -> str:
    places = [f"in {path}"]
    places += [f"in the servos of {', '.join(written)}"] if written else []
    missing = f", but not yet in those of {', '.join(left)}: calibrate again before you start the arm" if left else ""
    return f"the new calibration is stored {' and '.join(places)}{missing}"


def restart(bus: Bus, joints: Sequence[Joint], clock: Clock) -> None:
    """Restart servos whose torque is off, so that they discard the turns that they counted while the arm was moved.

    Otherwise, a servo that was turned across its seam would move by a whole turn at its next goal. A servo that does
    not respond does not prevent the restart of the other servos. Raises ServoError, with a note for each further servo
    that does not respond.
    """
    turned = [joint for joint in joints if can_move_seam(joint.model)]
    failed = _failed(lambda joint: retry(partial(bus.reboot, joint.servo_id)), turned)
    if turned:
        clock.sleep_until(clock.now() + RESTART_S)
    failed |= _failed(partial(_require_restarted, bus), [joint for joint in turned if joint.name not in failed])
    if failed:
        first, *others = failed.values()
        for other in others:
            first.add_note(str(other))
        raise first


def _failed(action: Callable[[Joint], None], joints: Sequence[Joint]) -> dict[str, ServoError]:
    """Perform an action for each joint. Return the errors, keyed by joint name."""
    errors: dict[str, ServoError] = {}
    for joint in joints:
        try:
            action(joint)
        except ServoError as error:
            errors[joint.name] = error
    return errors


def _require_restarted(bus: Bus, joint: Joint) -> None:
    """Raise ServoError if a servo does not respond after its restart."""
    retry(partial(bus.ping, joint.servo_id))
    if series_of(joint.model) is X:
        bus.identify(joint.servo_id, joint.model)  # This also tells the bus the operating mode, on which counts depend.


def _readings(bus: Bus, joints: Sequence[Joint], clock: Clock) -> dict[int, Reading]:
    """Read the states of servos. A servo that is briefly silent is read again."""
    missing = [joint.servo_id for joint in joints]
    readings = dict(bus.read_states(missing))
    for _ in range(ATTEMPTS - 1):
        missing = [i for i, reading in readings.items() if not isinstance(reading, ServoState)]
        if not missing:
            break
        clock.sleep_until(clock.now() + AGAIN_S)
        readings |= bus.read_states(missing)
    return readings


def _check(joints: Sequence[Joint], readings: Mapping[int, Reading], made: Mapping[str, JointCalibration]) -> None:
    """Check that each servo reports a position within its travel. Raises CalibrationError otherwise."""
    problems: list[str] = []
    for joint in joints:
        reading, travel = readings[joint.servo_id], made[joint.name]
        if not isinstance(reading, ServoState):
            problems.append(f"{joint.name} (servo {joint.servo_id}): {reading.text} after the restart")
        elif not travel.lower_counts - SLACK_COUNTS <= reading.position_counts <= travel.upper_counts + SLACK_COUNTS:
            problems.append(
                f"{joint.name} (servo {joint.servo_id}) reports {reading.position_counts} counts, outside its travel "
                f"of {travel.lower_counts} to {travel.upper_counts}: calibrate it again"
            )
    if problems:
        raise CalibrationError("\n".join(problems))
