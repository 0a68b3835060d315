"""Storing a calibration: the file first, then the servos' homing offsets, then a restart of those that were turned."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import yaml

from calibration.eeprom import Change
from commissioning.atomic_write import cannot_write, write_whole
from commissioning.calibrate.result import CalibrationError, JointCalibration
from commissioning.calibrate.seam import can_move_seam, write_counting
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.bus.types import ServoState
from drivers.clock import Clock
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from hal.joint import Joint
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


RESTART_S: Final = 1.5
"""A servo needs 0.8 s to come up again."""
SLACK_COUNTS: Final = 40
"""The arm is limp meanwhile, and a stop gives way a little."""


def store(
    robot: Path, bus: Bus, joints: Sequence[Joint], made: Mapping[str, JointCalibration], clock: Clock
) -> dict[str, tuple[Change, ...]]:
    """Write file and homing offsets; what was changed in the servos, by joint. Torque must be off.

    The file comes first: where it ends in between, a servo has another offset than the file says, and the arm is not
    brought up with it. Raises CalibrationError, ServoError, PortLost, with a note of what is stored where.
    """
    content = {joint.name: (joint.servo_id, made[joint.name]) for joint in joints}
    path = save(robot, content, in_servos=False)
    changes: dict[str, tuple[Change, ...]] = {}
    try:
        for joint in joints:
            changes[joint.name] = write_counting(bus, joint, made[joint.name].counting)
        restart(bus, joints, clock)
        _check(bus, joints, made)
        save(robot, content)
    except BaseException as error:
        error.add_note(_half_stored(path, list(changes), [j.name for j in joints if j.name not in changes]))
        raise
    return changes


def _half_stored(path: Path, written: Sequence[str], left: Sequence[str]) -> str:
    places = [f"in {path}"]
    places += [f"in the servos of {', '.join(written)}"] if written else []
    missing = f"; not yet in those of {', '.join(left)}: calibrate again before the arm is brought up" if left else ""
    return f"the new calibration is {' and '.join(places)}{missing}"


def restart(bus: Bus, joints: Sequence[Joint], clock: Clock) -> None:
    """Have limp servos forget the turns that they counted while the arm was moved.

    One that was turned over its seam would take its next goal for one that is a whole turn away.
    """
    turned = [joint for joint in joints if can_move_seam(joint.model)]
    for joint in turned:
        bus.reboot(joint.servo_id)
    if turned:
        clock.sleep_until(clock.now() + RESTART_S)
    for joint in turned:
        retry(lambda servo_id=joint.servo_id: bus.ping(servo_id))  # type: ignore[misc]
        if series_of(joint.model) is X:
            bus.identify(joint.servo_id, joint.model)  # the bus has to know the mode that it counts in


def _check(bus: Bus, joints: Sequence[Joint], made: Mapping[str, JointCalibration]) -> None:
    """Look whether each servo says a place within its travel. Raises CalibrationError with all that do not."""
    problems: list[str] = []
    readings = bus.read_states([joint.servo_id for joint in joints])
    for joint in joints:
        reading, travel = readings[joint.servo_id], made[joint.name]
        if not isinstance(reading, ServoState):
            problems.append(f"{joint.name} (servo {joint.servo_id}): {reading.text} after the restart")
        elif not travel.lower_counts - SLACK_COUNTS <= reading.position_counts <= travel.upper_counts + SLACK_COUNTS:
            problems.append(
                f"{joint.name} (servo {joint.servo_id}) says {reading.position_counts}, outside its travel "
                f"{travel.lower_counts} to {travel.upper_counts}: calibrate it again"
            )
    if problems:
        raise CalibrationError("\n".join(problems))
