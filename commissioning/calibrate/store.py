"""Storing a calibration: the file first, then the servos' homing offsets, then a restart of those that were turned."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from calibration.eeprom import Change
from commissioning.calibrate.file import save
from commissioning.calibrate.result import CalibrationError, JointCalibration
from commissioning.calibrate.seam import can_move_seam, write_counting
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.bus.types import ServoState
from drivers.clock import Clock
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from hal.joint import Joint

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
