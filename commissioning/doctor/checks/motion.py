"""Check the motion test for blocked joints, wrong gears, sag and oscillation."""

from collections.abc import Iterator
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, ServoSnapshot, write
from commissioning.drive_trial import STUCK_SHARE, TrialMotion
from hal.joint import Joint

SHAKES_COUNTS: Final = 12.0
"""Maximum oscillation at rest, in counts (about 1 degree). Backlash alone causes less oscillation than this."""
GIVES_WAY: Final = 2.0
"""Maximum position error, as a multiple of the error explained by stiffness, dead band and friction."""
SPEED_FACTOR: Final = 1.5
"""Minimum ratio of speed to drive that indicates a different gear, as a multiple of the model's value.

The other gears of an STS3215 are 1.8 times (1:191) and 2.3 times (1:147) faster than 1:345.
"""


def check_motion(snapshot: ArmSnapshot) -> Iterator[Finding]:
    """Check every joint that was moved."""
    known = {servo.joint.name: (place_of(bus, servo), servo) for bus in snapshot.buses for servo in bus.servos}
    test = snapshot.motion_test
    if test.failed:
        cause = (
            f"{test.failed}. Support the arm, and switch its supply off if a servo still holds its position. Then run "
            "the doctor again"
        )
        yield finding("motion_failed", FindingPlace(), "the motion test failed", cause)
    if test.not_moved:
        yield finding("not_moved", FindingPlace(), "the motion test was not done or not finished", test.not_moved)
    for motion in test.motions:
        place, servo = known[motion.joint.name]
        restless = list(_rest(place, servo, motion))
        # The drive of a joint that sags or oscillates does not indicate its gear.
        yield from restless or _way(place, motion)


def _way(place: FindingPlace, motion: TrialMotion) -> Iterator[Finding]:
    if ratio := gear_ratio(motion):
        cause = (
            f"At the same drive, the servo turns {ratio:.1f} times faster than an {motion.joint.model.name}. It "
            f"probably has a different "
            f"gear: 1:147 and 1:191 are faster than 1:345, but weaker. Check the label of the servo and "
            "replace it"
        )
        yield finding("wrong_gear", place, "the joint is weaker and faster than the other joints", cause)


def _stuck(place: FindingPlace, motion: TrialMotion) -> Finding:
    cause = (
        f"The joint was commanded to move by {motion.asked:+.3f}, but it moved by {motion.moved:+.3f}. Check whether "
        "something is in its way, whether it is at a stop, and whether its horn is loose. The servo may also lack "
        "force: check its torque limit and the supply"
    )
    return finding("does_not_move", place, "the joint does not follow commands", cause)


def gear_ratio(motion: TrialMotion) -> float | None:
    """Return the ratio of the servo's speed to its model's speed at the same drive.

    Return None if the ratio is not clearly above 1.
    """
    ratio = motion.faster
    return ratio if ratio is not None and ratio > SPEED_FACTOR else None


def _rest(place: FindingPlace, servo: ServoSnapshot, motion: TrialMotion) -> Iterator[Finding]:
    joint, count = motion.joint, abs(motion.joint.units_per_count)
    if motion.moved / motion.asked < STUCK_SHARE:
        yield _stuck(place, motion)
        return
    if motion.swing > SHAKES_COUNTS * count:
        cause = (
            f"At rest the joint swings by {motion.swing:.4f} {_unit(joint)}, because position_p is too high for its "
            f"load and backlash. Lower position_p (LeRobot uses 16), and add it to settings in the robot file"
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
            f"The position error at rest is {motion.error:.4f} {_unit(joint)}, but the gains and the masses in the "
            f"URDF explain only {allowed / GIVES_WAY:.4f}. Possible causes: position_p is lower than in the robot "
            "file, the load is heavier than in the URDF, the servo has another gear, or something presses on the joint"
        )
        yield finding("gives_way", place, "the joint sags or stops short of its goals", cause)


def _unit(joint: Joint) -> str:
    return joint.unit
