"""What a small slow motion shows of a joint: direction, gear, how far it gives way, whether it shakes, the supply."""

from collections.abc import Iterator
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, Place, finding
from commissioning.doctor.snapshot import ServoSnapshot, Snapshot, write
from commissioning.drive_trial import STUCK_SHARE, JointMotion
from hal.joint import Joint

SHAKES_COUNTS: Final = 12.0
"""Between the outermost positions at rest, 1 degree: more than backlash makes of the least drive."""
GIVES_WAY: Final = 2.0
"""Times what stiffness, dead band and friction explain."""
SPEED_FACTOR: Final = 1.5
"""The other gears of an STS3215 are 1.8 (1:191) and 2.3 times (1:147) faster than 1:345."""


def check_motion(snapshot: Snapshot) -> Iterator[Finding]:
    """Every joint that was moved."""
    known = {servo.joint.name: (place_of(bus, servo), servo) for bus in snapshot.buses for servo in bus.servos}
    if snapshot.not_moved:
        yield finding("not_moved", Place(), "gears, gains and gravity hold were not tried", snapshot.not_moved)
    for motion in snapshot.motions:
        place, servo = known[motion.joint.name]
        restless = list(_rest(place, servo, motion))
        yield from restless or _way(place, motion)  # the drive of a joint that sags or swings says nothing of its gear


def _way(place: Place, motion: JointMotion) -> Iterator[Finding]:
    if ratio := gear_ratio(motion):
        cause = (
            f"for each rad/s it needs {ratio:.1f} times less drive than a {motion.joint.model.name}: its gear is "
            "probably another one (1:147 and 1:191 are faster than 1:345, and weaker)"
        )
        yield finding("wrong_gear", place, "the joint is weaker and faster than the others", cause)


def _stuck(place: Place, motion: JointMotion) -> Finding:
    cause = (
        f"sent by {motion.asked:+.3f} it moved by {motion.moved:+.3f}: something is in its way, it is at a stop, "
        "its horn is loose, or it has no force (its torque limit, the supply)"
    )
    return finding("does_not_move", place, "the joint does not move when it is sent", cause)


def gear_ratio(motion: JointMotion) -> float | None:
    """By how much the servo is faster for its drive than its model; None where it is not, or cannot be told."""
    ratio = motion.faster
    return ratio if ratio is not None and ratio > SPEED_FACTOR else None


def _rest(place: Place, servo: ServoSnapshot, motion: JointMotion) -> Iterator[Finding]:
    joint, count = motion.joint, abs(motion.joint.units_per_count)
    if motion.moved / motion.asked < STUCK_SHARE:
        yield _stuck(place, motion)
        return
    if motion.swing > SHAKES_COUNTS * count:
        cause = (
            f"at rest it swings by {motion.swing:.4f} {_unit(joint)}: its position_p is too high for its load and "
            "backlash. Lower it (LeRobot takes 16), and name it under settings in the robot file"
        )
        command = write(servo, "position_p", 16)
        yield finding("shakes", place, "the joint shakes or hums", cause, command)
        return
    compliance = joint.compliance
    if compliance is None:
        return
    allowed = GIVES_WAY * (abs(motion.expected_sag) + compliance.uncorrected)
    if motion.error > allowed:
        cause = (
            f"it stays {motion.error:.4f} {_unit(joint)} off, and its gains and the URDF's masses explain "
            f"{allowed / GIVES_WAY:.4f}: its position_p is lower than the robot file says, it carries more than "
            "the URDF does, its gear is another one, or something presses on it"
        )
        yield finding("gives_way", place, "the joint sags, or stops short of its goals", cause)


def _unit(joint: Joint) -> str:
    return "rad" if joint.transmission == 1.0 else "m"
