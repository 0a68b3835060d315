"""The arm: where joints stand against their limits, and the calibration file against EEPROM and URDF."""

from collections.abc import Iterator

from commissioning.calibrate.result import JointCalibration, doubts
from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, Place, finding
from commissioning.doctor.snapshot import BusSnapshot, ServoSnapshot, Snapshot, on, write
from hal.robot_file.calibration_file import CalibrationFile
from hal.servos.activation import counted_turns
from hal.types import far_outside


def check_arm(snapshot: Snapshot) -> Iterator[Finding]:
    """What is wrong only for an arm, and would be right for a servo by itself."""
    for bus in snapshot.buses:
        offsets = _wrong_offsets(bus)
        calibrate = _calibrate(snapshot, bus)
        yield from _exchanged(bus, offsets)
        for servo in bus.servos:
            if servo in offsets:
                yield _offset_differs(bus, servo)
            if servo.states:
                yield from _outside(place_of(bus, servo), servo, calibrate)
            yield from _calibrated(place_of(bus, servo), servo, snapshot.calibration, calibrate)
    if snapshot.calibration is None and any(servo.answers for bus in snapshot.buses for servo in bus.servos):
        cause = (
            "there is no calibration file beside the robot file: the servos' zeros are taken to be those that "
            "the robot file names. Planner and simulator agree with the arm only if somebody has measured them"
        )
        yield finding("not_calibrated", Place(), "the arm stands elsewhere than in RViz or the simulator", cause,
                      _calibrate(snapshot, snapshot.buses[0]))  # fmt: skip


def _calibrate(snapshot: Snapshot, bus: BusSnapshot) -> str:
    return f"servoloop calibrate --arm {snapshot.arm} --port {bus.port}"


def _wrong_offsets(bus: BusSnapshot) -> list[ServoSnapshot]:
    return [
        servo
        for servo in bus.servos
        if servo.joint.homing_offset is not None
        and servo.registers.get("homing_offset", servo.joint.homing_offset) != servo.joint.homing_offset
    ]


def _exchanged(bus: BusSnapshot, wrong: list[ServoSnapshot]) -> Iterator[Finding]:
    """Two servos of which each has what was calibrated for the other one."""
    for at, one in enumerate(wrong):
        for other in wrong[at + 1 :]:
            if (one.registers["homing_offset"], other.registers["homing_offset"]) == (
                other.joint.homing_offset,
                one.joint.homing_offset,
            ):
                a, b = one.joint, other.joint
                cause = (
                    f"servo {a.servo_id} has the homing offset that {b.name} was calibrated with, and servo "
                    f"{b.servo_id} that of {a.name}: the two have exchanged their IDs since. Give them back, the first "
                    "by way of a free ID"
                )
                command = on(bus.port, "set-id", a.servo_id, "NEW")
                yield finding(
                    "ids_exchanged", Place(bus=bus.name), f"{a.name} moves when {b.name} is sent", cause, command
                )


def _offset_differs(bus: BusSnapshot, servo: ServoSnapshot) -> Finding:
    held, wanted = servo.registers["homing_offset"], servo.joint.homing_offset or 0
    cause = (
        f"its homing_offset is {held}, and it was calibrated with {wanted}: the servo was swapped or reset, or another "
        "program has written its own calibration. Write the register back, or calibrate again"
    )
    command = write(servo, "homing_offset", wanted)
    return finding(
        "homing_offset_differs", place_of(bus, servo), "recalibration is asked for at every run", cause, command
    )


def _outside(place: Place, servo: ServoSnapshot, calibrate: str) -> Iterator[Finding]:
    joint = servo.joint
    counts = servo.states[-1].position_counts
    position = joint.position(counts)
    lower, upper = joint.limits.lower, joint.limits.upper
    if far_outside(position, joint.limits):
        if turned := counted_turns(joint, counts):
            yield finding("turn_counted", place, "the arm does not come up: a joint is a turn away", turned)
            return
        cause = (
            f"it says {position:.3f}, and its limits are {lower:.3f} to {upper:.3f}: no torque is given there. If "
            "the joint really stands there move it by hand; if not, its zero or its direction is wrong: calibrate"
        )
        yield finding(
            "outside_limits", place, "the arm does not come up: a joint is outside its limits", cause, calibrate
        )


def _calibrated(
    place: Place, servo: ServoSnapshot, calibration: CalibrationFile | None, calibrate: str
) -> Iterator[Finding]:
    found = calibration.joints.get(servo.joint.name) if calibration else None
    if found is None:
        return
    if not 0 <= found.lower_counts < found.upper_counts <= servo.joint.model.last_count:
        cause = (
            f"its travel was measured as {found.lower_counts} to {found.upper_counts} counts, which crosses the end of "
            "the encoder: there the reading leaps by a turn"
        )
        yield finding("seam_in_range", place, "the joint leaps, or its range is 0 to 4095", cause, calibrate)
        return
    made = JointCalibration(found.sign, found.zero_counts, found.homing_offset, found.lower_counts, found.upper_counts)
    if doubt := doubts(servo.joint.between_stops(), made):
        yield finding("travel_differs", place, "wrong limits: a stop is hit early, or never reached", doubt, calibrate)
