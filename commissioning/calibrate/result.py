"""Compute a joint's calibration from its sweep, direction and anchor, and check it against the URDF."""

from dataclasses import dataclass, replace
from math import ceil, floor, tau
from typing import Final

from commissioning.calibrate.seam import SEAM_MARGIN_COUNTS, Counting, off_the_seam
from commissioning.commissioning_errors import CalibrationError
from drivers.servos.angles import Travel
from hal.joint import Joint

SWEPT_SHARE: Final = 0.8
"""Minimum travel of a joint that was swept from stop to stop, as a fraction of its URDF range."""
DOUBTFUL_SHARE: Final = 0.03
"""Maximum difference between travel and URDF range, as a fraction of the range. A larger difference may mean a wrong
part.
"""
PRESSED_RAD: Final = 0.08
"""Sum of the angles by which the user presses a joint into its two stops, in rad of the servo's shaft."""
MISSING_RAD: Final = 0.04
"""Maximum angle by which a travel may be shorter than the URDF range, in rad of the servo's shaft.

If the zero is defined as the middle of the travel, the error of the zero is half of the missing angle.
"""
PLACE_RAD: Final = 0.05
"""Maximum distance between the middle of a travel and the middle of the URDF limits, in rad."""
PLAY_RAD: Final = 0.01
"""Uncertainty of every measurement, in rad: half of the typical backlash plus one count."""
EYE_RAD: Final = 0.05
"""Uncertainty of a pose that is judged by eye and not confirmed by a stop, in rad."""


@dataclass(frozen=True, slots=True)
class JointCalibration:
    """Calibration of one joint, in the counts that the servo reports when ``homing_offset`` is set."""

    sign: int
    zero_counts: int
    homing_offset: int | None
    """Homing offset of the servo; None if the servo has no usable homing offset."""
    lower_counts: int
    """Smallest count in the travel. This count may belong to the upper stop of the joint."""
    upper_counts: int
    """Largest count in the travel."""
    extended: bool = False
    """Whether the servo is a Dynamixel X in extended position mode."""

    @property
    def counting(self) -> Counting:
        """Settings of the servo that determine its counts."""
        return Counting(self.homing_offset, self.extended)

    def travel(self, joint: Joint) -> float:
        """Return the distance from stop to stop, in rad or m."""
        return (self.upper_counts - self.lower_counts) * unit(joint)

    def stops(self, joint: Joint) -> tuple[float, float]:
        """Return the joint positions at both ends of the travel, smaller position first, in rad or m."""
        ends = [
            self.sign * (counts - self.zero_counts) * unit(joint) for counts in (self.lower_counts, self.upper_counts)
        ]
        return min(ends), max(ends)


@dataclass(frozen=True, slots=True)
class FoundZero:
    """Measurement of one joint, in continuous counts that were read while ``homing_offset`` was set."""

    travel: Travel
    sign: int
    anchor_counts: float
    anchor_position: float
    homing_offset: int | None
    extended: bool = False
    """Whether the counts were read in the extended position mode of a Dynamixel X."""


def unit(joint: Joint) -> float:
    """Return the change in joint position per count, without the sign, in rad or m."""
    return joint.transmission * tau / joint.model.counts_per_turn


def turns_freely(joint: Joint) -> bool:
    """Return whether the joint has no stops because its URDF range is a full turn of its servo."""
    range_counts = (joint.limits.upper - joint.limits.lower) / unit(joint)
    return range_counts > joint.model.counts_per_turn - 2 * SEAM_MARGIN_COUNTS


def fills_the_turn(joint: Joint, travel: Travel) -> bool:
    """Return whether the joint has no stops because it was moved through at least one full turn of its servo."""
    return travel.span > joint.model.counts_per_turn - 2


def calibration_of(joint: Joint, found: FoundZero) -> JointCalibration:
    """Return the calibration of one joint. Raises CalibrationError if the seam cannot be kept out of the joint's range.

    For a joint that turns freely, only the URDF range matters. The seam is placed opposite the middle of this range,
    and the travel is the full turn.
    """
    zero = found.anchor_counts - found.sign * found.anchor_position / unit(joint)
    free = turns_freely(joint) or fills_the_turn(joint, found.travel)
    limits = _limits_in_counts(joint, found.sign, zero)
    needed = limits if free else _both(found.travel, limits)
    shifted, counting = _off_the_seam(joint, needed, Counting(found.homing_offset, found.extended))
    by = shifted.lower - needed.lower
    travel = Travel(-by, joint.model.last_count - by) if free else found.travel
    return JointCalibration(
        found.sign,
        round(zero) + by,
        counting.homing_offset,
        travel.lower + by,
        travel.upper + by,
        counting.extended,
    )


def _limits_in_counts(joint: Joint, sign: int, zero: float) -> Travel:
    """Return the URDF limits in continuous counts."""
    ends = [zero + sign * end / unit(joint) for end in (joint.limits.lower, joint.limits.upper)]
    return Travel(floor(min(ends)), ceil(max(ends)))


def _both(one: Travel, other: Travel) -> Travel:
    """Return the smallest range that contains both ranges."""
    return Travel(min(one.lower, other.lower), max(one.upper, other.upper))


def _off_the_seam(joint: Joint, needed: Travel, counting: Counting) -> tuple[Travel, Counting]:
    """Return the range in counts that does not cross the seam, and the corresponding servo settings."""
    turn = joint.model.counts_per_turn
    if needed.span > turn:
        raise CalibrationError(
            f"{joint.name}: its stops and its limits in the URDF span {needed.span} counts, but one turn of the servo "
            f"has only {turn}. Check the limits in the URDF, and make sure that the joint is in the requested pose"
        )
    found = off_the_seam(joint.model, needed, counting)
    if found is None:
        raise CalibrationError(f"{joint.name}: {cannot_move_seam(joint)}")
    return found


def cannot_move_seam(joint: Joint) -> str:
    """Return the cause and the remedy if a joint's range contains a fixed encoder seam."""
    return (
        f"the reading of its servo ({joint.servo_id}) wraps from the last count to 0 within the joint's range, and an "
        f"{joint.model.name} cannot move this position. Take the horn off, turn the servo to the middle of its range, "
        "and mount the horn again"
    )


def travel_warnings(joint: Joint, calibration: JointCalibration) -> str:
    """Return warnings about an implausible length or position of the travel; an empty string if both are plausible."""
    travel, range_ = calibration.travel(joint), joint.limits.upper - joint.limits.lower
    if turns_freely(joint):
        return ""
    if travel < SWEPT_SHARE * range_:
        return f"it was moved through only {travel:.3f} of {range_:.3f} in the URDF, so it did not reach both stops"
    sentences = []
    if not range_ - missing_allowed(joint) <= travel <= range_ + _longer_allowed(joint):
        sentences.append(
            f"its travel is {travel:.3f}, but {range_:.3f} in the URDF ({travel / range_ - 1.0:+.1%}). "
            "Was a stop missed, or does a part differ from the URDF?"
        )
    if place := position_warning(joint, calibration):
        sentences.append(place)
    return " ".join(sentences)


def missing_allowed(joint: Joint) -> float:
    """Return the maximum plausible difference between a short travel and the joint's URDF range, in rad or m."""
    return min(DOUBTFUL_SHARE * (joint.limits.upper - joint.limits.lower), MISSING_RAD * joint.transmission)


def _longer_allowed(joint: Joint) -> float:
    return max(DOUBTFUL_SHARE * (joint.limits.upper - joint.limits.lower), PRESSED_RAD * joint.transmission)


def pressed_counts(joint: Joint, travel: Travel) -> float:
    """Return the distance by which the joint was pressed into each of its stops, in counts.

    This is half of the difference between the travel and the URDF's range. The result is 0 if the travel is not longer
    than the range. The result is also 0 if the travel exceeds the range by so much that the actual stops must differ
    from the stops in the URDF.
    """
    longer = travel.span * unit(joint) - (joint.limits.upper - joint.limits.lower)
    return 0.5 * longer / unit(joint) if 0.0 < longer <= PRESSED_RAD * joint.transmission else 0.0


def position_warning(joint: Joint, calibration: JointCalibration) -> str:
    """Return a warning about a travel that does not match the URDF limits; an empty string if it matches."""
    if turns_freely(joint) or abs(off := misplaced(joint, calibration)) <= PLACE_RAD * joint.transmission:
        return ""
    (lower, upper), limits = calibration.stops(joint), joint.limits
    cause = "was it moved in the wrong direction, or " if is_mirrored(joint, calibration) else ""
    return (
        f"its stops are at {lower:.3f} and {upper:.3f}, but at {limits.lower:.3f} and {limits.upper:.3f} in the URDF: "
        f"{cause}is its zero off by {abs(off):.3f}?"
    )


def misplaced(joint: Joint, calibration: JointCalibration) -> float:
    """Return the distance between the middle of the travel and the middle of the URDF limits, in rad or m."""
    return 0.5 * sum(calibration.stops(joint)) - 0.5 * (joint.limits.lower + joint.limits.upper)


def is_mirrored(joint: Joint, calibration: JointCalibration) -> bool:
    """Return whether the travel matches the URDF limits only if the direction is reversed."""
    other_way = misplaced(joint, replace(calibration, sign=-calibration.sign))
    allowed = PLACE_RAD * joint.transmission
    return abs(other_way) <= allowed < abs(misplaced(joint, calibration))


def uncertainty(joint: Joint, calibration: JointCalibration, zero: str) -> float:
    """Return the expected error of the stored zero, in rad or m. ``zero`` is the value of ``JointPlan.zero``."""
    if turns_freely(joint):
        return EYE_RAD * joint.transmission
    longer = calibration.travel(joint) - (joint.limits.upper - joint.limits.lower)
    at_stop = zero.endswith("stop") and longer < 0.0  # Excess travel is divided equally between both stops.
    by_travel = -longer if at_stop else max(0.5 * abs(longer), abs(misplaced(joint, calibration)))
    return PLAY_RAD * joint.transmission + by_travel
