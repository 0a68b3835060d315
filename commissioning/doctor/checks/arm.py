"""Check the arm: compare joint positions with the limits, and the calibration file with EEPROM and URDF."""

from collections.abc import Iterator

from commissioning.calibrate.result import JointCalibration, travel_warnings
from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, ServoSnapshot, on, write
from hal.robot_file.calibration_file import CalibrationFile
from hal.servos.start_goal import counted_turns
from hal.types import far_outside


def check_arm(snapshot: ArmSnapshot) -> Iterator[Finding]:
    """Find problems of the arm as a whole."""
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
            "There is no calibration file next to the robot file, so the zeros in the robot file are used. Unless they "
            "were measured on this arm, its pose differs from the pose in RViz. Calibrate the arm"
        )
        yield finding("not_calibrated", FindingPlace(), "the pose of the arm differs from RViz or the simulator", cause,
                      _calibrate(snapshot, snapshot.buses[0]))  # fmt: skip


def _calibrate(snapshot: ArmSnapshot, bus: BusSnapshot) -> str:
    return f"servoloop calibrate --arm {snapshot.arm} {bus.port_option()}"


def _wrong_offsets(bus: BusSnapshot) -> list[ServoSnapshot]:
    return [
        servo
        for servo in bus.servos
        if servo.joint.homing_offset is not None
        and servo.registers.get("homing_offset", servo.joint.homing_offset) != servo.joint.homing_offset
    ]


def _exchanged(bus: BusSnapshot, wrong: list[ServoSnapshot]) -> Iterator[Finding]:
    """Find pairs of servos whose homing offsets are swapped."""
    for at, one in enumerate(wrong):
        for other in wrong[at + 1 :]:
            if (one.registers["homing_offset"], other.registers["homing_offset"]) == (
                other.joint.homing_offset,
                one.joint.homing_offset,
            ):
                a, b = one.joint, other.joint
                cause = (
                    f"Servo {a.servo_id} has the homing offset of {b.name}, and servo {b.servo_id} has the homing "
                    f"offset of {a.name}. So their IDs were swapped after the calibration. Swap them back: "
                    "give the first servo a free ID, then set both to their own IDs"
                )
                command = on(bus.port, "set-id", a.servo_id, "NEW")
                yield finding(
                    "ids_exchanged", FindingPlace(bus=bus.name), f"{a.name} moves instead of {b.name}", cause, command
                )


def _offset_differs(bus: BusSnapshot, servo: ServoSnapshot) -> Finding:
    held, wanted = servo.registers["homing_offset"], servo.joint.homing_offset or 0
    cause = (
        f"The homing offset in the servo is {held}, but the joint was calibrated with {wanted}. Either the servo was "
        "replaced or reset, or another program wrote its own calibration. Write the offset back, or calibrate again"
    )
    command = write(servo, "homing_offset", wanted)
    return finding(
        "homing_offset_differs", place_of(bus, servo), "programs request a new calibration at every start", cause,
        command
    )  # fmt: skip


def _outside(place: FindingPlace, servo: ServoSnapshot, calibrate: str) -> Iterator[Finding]:
    joint = servo.joint
    counts = servo.states[-1].position_counts
    position = joint.position(counts)
    lower, upper = joint.limits.lower, joint.limits.upper
    if far_outside(position, joint.limits):
        if turned := counted_turns(joint, counts):
            yield finding("turn_counted", place, "the arm does not start: a joint is off by a whole turn", turned)
            return
        cause = (
            f"The measured position is {position:.3f}, outside the limits {lower:.3f} to {upper:.3f}, so torque is "
            "not enabled. If the joint really is at this position, move it back by hand. If not, its zero or its "
            "direction is wrong: calibrate it"
        )
        yield finding(
            "outside_limits", place, "the arm does not start: a joint is outside its limits", cause, calibrate
        )


def _calibrated(
    place: FindingPlace, servo: ServoSnapshot, calibration: CalibrationFile | None, calibrate: str
) -> Iterator[Finding]:
    found = calibration.joints.get(servo.joint.name) if calibration else None
    if found is None:
        return
    if found.crosses_seam(servo.joint.model.last_count):
        cause = (
            f"In the calibration file, the travel of the joint is {found.lower_counts} to {found.upper_counts} "
            "counts. This range "
            "crosses the end of the encoder, where the reading jumps by a whole turn. Calibrate again"
        )
        yield finding("seam_in_range", place, "the joint jumps, or its range is 0 to 4095", cause, calibrate)
        return
    made = JointCalibration(found.sign, found.zero_counts, found.homing_offset, found.lower_counts, found.upper_counts)
    if doubt := travel_warnings(servo.joint.between_stops(), made):
        cause = f"Calibrate this joint again, because {doubt}"
        yield finding("travel_differs", place, "wrong limits: a stop is hit early or never reached", cause, calibrate)
