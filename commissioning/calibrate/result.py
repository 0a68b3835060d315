"""A joint's calibration from its sweep, direction and anchor: sign, zero, homing offset; and doubts about it."""

from dataclasses import dataclass, replace
from math import ceil, floor, tau
from typing import Final

from calibration.angles import Travel
from commissioning.calibrate.seam import SEAM_MARGIN_COUNTS, Counting, off_the_seam
from hal.joint import Joint

SWEPT_SHARE: Final = 0.8
"""A joint that was moved through less of its URDF's range was not swept from stop to stop."""
DOUBTFUL_SHARE: Final = 0.03
"""A travel that is longer than the URDF's range by more is doubtful: a part may be another."""
PRESSED_RAD: Final = 0.08
"""A hand presses a joint into both of its stops by so much together, rad of the servo's shaft."""
MISSING_RAD: Final = 0.04
"""A travel that is shorter than the URDF's range by more is doubtful, rad of the servo's shaft.

Half of what is missing is the error of a zero in the middle of the travel.
"""
PLACE_RAD: Final = 0.05
"""Largest distance between the middle of a travel and the middle of the URDF's limits without a doubt, rad."""
PLAY_RAD: Final = 0.01
"""Uncertainty of every measurement: half of the usual backlash, and a count, rad."""
EYE_RAD: Final = 0.05
"""Uncertainty of a pose that is judged by eye, and that no stop confirms, rad."""


class CalibrationError(Exception):
    """A calibration that cannot be finished; the text says what to do."""


@dataclass(frozen=True, slots=True)
class JointCalibration:
    """One joint's calibration, in counts as the servo says them with ``homing_offset``."""

    sign: int
    zero_counts: int
    homing_offset: int | None
    """None: the servo has no such register, or none that can be used."""
    lower_counts: int
    """The lower end of the travel by count, whichever end of the joint's that is."""
    upper_counts: int
    extended: bool = False
    """Whether the counts are those of a Dynamixel X in extended position mode."""

    @property
    def counting(self) -> Counting:
        """How the servo counts."""
        return Counting(self.homing_offset, self.extended)

    def travel(self, joint: Joint) -> float:
        """The way from stop to stop, rad or m."""
        return (self.upper_counts - self.lower_counts) * unit(joint)

    def stops(self, joint: Joint) -> tuple[float, float]:
        """The joint's positions at both ends of its travel, the smaller one first, rad or m."""
        ends = [
            self.sign * (counts - self.zero_counts) * unit(joint) for counts in (self.lower_counts, self.upper_counts)
        ]
        return min(ends), max(ends)


@dataclass(frozen=True, slots=True)
class Found:
    """The measurement of one joint: continuous counts, read with ``homing_offset``."""

    travel: Travel
    sign: int
    anchor_counts: float
    anchor_position: float
    homing_offset: int | None
    extended: bool = False
    """Whether they were read in the extended position mode of a Dynamixel X."""


def unit(joint: Joint) -> float:
    """rad or m per count, without the sign."""
    return joint.transmission * tau / joint.model.counts_per_turn


def turns_freely(joint: Joint) -> bool:
    """Whether the joint's range in the URDF is its servo's whole turn: no stop shows where it is."""
    range_counts = (joint.limits.upper - joint.limits.lower) / unit(joint)
    return range_counts > joint.model.counts_per_turn - 2 * SEAM_MARGIN_COUNTS


def fills_the_turn(joint: Joint, travel: Travel) -> bool:
    """Whether the joint was moved through its servo's whole turn, or more: its stops are none."""
    return travel.span > joint.model.counts_per_turn - 2


def calibration_of(joint: Joint, found: Found) -> JointCalibration:
    """The calibration of one joint. Raises CalibrationError where the seam cannot be kept out of its range.

    Of a joint that turns freely the range in the URDF alone counts: the seam lies opposite its middle, and the travel
    is the whole turn.
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
    """The URDF's limits, in continuous counts."""
    ends = [zero + sign * end / unit(joint) for end in (joint.limits.lower, joint.limits.upper)]
    return Travel(floor(min(ends)), ceil(max(ends)))


def _both(one: Travel, other: Travel) -> Travel:
    """Everything that the servo must be able to report: its travel, and the URDF's range."""
    return Travel(min(one.lower, other.lower), max(one.upper, other.upper))


def _off_the_seam(joint: Joint, needed: Travel, counting: Counting) -> tuple[Travel, Counting]:
    """The range as the servo reports it where that does not cross the seam, and how it must count for that."""
    turn = joint.model.counts_per_turn
    if needed.span > turn:
        raise CalibrationError(
            f"{joint.name}: its stops and its limits in the URDF are {needed.span} counts apart, more than the servo's "
            f"turn of {turn}: are the limits right, and was the pose held that was asked for?"
        )
    found = off_the_seam(joint.model, needed, counting)
    if found is None:
        raise CalibrationError(f"{joint.name}: {cannot_move_seam(joint)}")
    return found


def cannot_move_seam(joint: Joint) -> str:
    """The reason and the cure where a servo's seam lies in its joint's range and stays there."""
    return (
        f"its servo ({joint.servo_id}) passes from its last count to its first within the joint's range, and a "
        f"{joint.model.name} cannot move that place: take the horn off, turn the servo to its middle, put it on again"
    )


def doubts(joint: Joint, calibration: JointCalibration) -> str:
    """The doubts about length and place of the travel, in sentences; empty where there are none."""
    travel, range_ = calibration.travel(joint), joint.limits.upper - joint.limits.lower
    if turns_freely(joint):
        return ""
    if travel < SWEPT_SHARE * range_:
        return f"was moved through {travel:.3f} of {range_:.3f} in the URDF: not from stop to stop"
    sentences = []
    if not range_ - missing_allowed(joint) <= travel <= range_ + _longer_allowed(joint):
        sentences.append(
            f"its travel is {travel:.3f}, the URDF's {range_:.3f}: {travel / range_ - 1.0:+.1%}. "
            "Was a stop missed, or is a part another?"
        )
    if place := place_doubt(joint, calibration):
        sentences.append(place)
    return " ".join(sentences)


def missing_allowed(joint: Joint) -> float:
    """Largest length by which the joint's travel may be shorter than its URDF's range without a doubt, rad or m."""
    return min(DOUBTFUL_SHARE * (joint.limits.upper - joint.limits.lower), MISSING_RAD * joint.transmission)


def _longer_allowed(joint: Joint) -> float:
    return max(DOUBTFUL_SHARE * (joint.limits.upper - joint.limits.lower), PRESSED_RAD * joint.transmission)


def pressed_counts(joint: Joint, travel: Travel) -> float:
    """How far a joint was pressed into each of its stops, in counts, as its travel is longer than its URDF's range.

    0 where it is not longer, or by more than hands press: there the stops are others.
    """
    longer = travel.span * unit(joint) - (joint.limits.upper - joint.limits.lower)
    return 0.5 * longer / unit(joint) if 0.0 < longer <= PRESSED_RAD * joint.transmission else 0.0


def place_doubt(joint: Joint, calibration: JointCalibration) -> str:
    """The doubt about the place of the travel in a sentence; empty where it lies between the URDF's limits."""
    if turns_freely(joint) or abs(off := misplaced(joint, calibration)) <= PLACE_RAD * joint.transmission:
        return ""
    (lower, upper), limits = calibration.stops(joint), joint.limits
    cause = "was its direction shown the wrong way round, or " if is_mirrored(joint, calibration) else ""
    return (
        f"its stops are at {lower:.3f} and {upper:.3f}, the URDF's at {limits.lower:.3f} and {limits.upper:.3f}: "
        f"{cause}is its zero off by {abs(off):.3f}?"
    )


def misplaced(joint: Joint, calibration: JointCalibration) -> float:
    """How far the middle of the travel lies from the middle of the URDF's limits, rad or m."""
    return 0.5 * sum(calibration.stops(joint)) - 0.5 * (joint.limits.lower + joint.limits.upper)


def is_mirrored(joint: Joint, calibration: JointCalibration) -> bool:
    """Whether the travel lies between the URDF's limits only with the other direction."""
    other_way = misplaced(joint, replace(calibration, sign=-calibration.sign))
    allowed = PLACE_RAD * joint.transmission
    return abs(other_way) <= allowed < abs(misplaced(joint, calibration))


def uncertainty(joint: Joint, calibration: JointCalibration, zero: str) -> float:
    """Expected error of the stored zero, rad or m, by the place where it was found (``JointPlan.zero``)."""
    if turns_freely(joint):
        return EYE_RAD * joint.transmission
    longer = calibration.travel(joint) - (joint.limits.upper - joint.limits.lower)
    at_stop = zero.endswith("stop") and longer < 0.0  # pressed into both stops alike, the joint was in their middle
    by_travel = -longer if at_stop else max(0.5 * abs(longer), abs(misplaced(joint, calibration)))
    return PLAY_RAD * joint.transmission + by_travel
