"""A joint's calibration from its sweep, direction and anchor: sign, zero, homing offset; and doubts about it."""

from dataclasses import dataclass
from math import ceil, floor, tau
from typing import Final

from calibration.angles import LARGEST_OFFSET, Travel, moved, offset_for_travel
from hal.joint import Joint

SWEPT_SHARE: Final = 0.8
"""A joint that was moved through less of its URDF's range was not swept from stop to stop."""
DOUBTFUL_SHARE: Final = 0.03
"""A travel that differs by more from the URDF's range is worth a look: a stop was missed, or a part is another."""
SEAM_MARGIN_COUNTS: Final = 16
"""So far the travel stays from the seam: gears bend a little beyond their stops."""


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

    def travel(self, joint: Joint) -> float:
        """The way from stop to stop, rad or m."""
        return (self.upper_counts - self.lower_counts) * unit(joint)


@dataclass(frozen=True, slots=True)
class Found:
    """The measurement of one joint: continuous counts, read with ``homing_offset``."""

    travel: Travel
    sign: int
    anchor_counts: float
    anchor_position: float
    homing_offset: int | None


def unit(joint: Joint) -> float:
    """rad or m per count, without the sign."""
    return joint.transmission * tau / joint.model.counts_per_turn


def calibration_of(joint: Joint, found: Found) -> JointCalibration:
    """The calibration of one joint. Raises CalibrationError where the seam cannot be kept out of its range."""
    zero = found.anchor_counts - found.sign * found.anchor_position / unit(joint)
    needed = _range_needed(joint, found, zero)
    shifted, offset = _off_the_seam(joint, needed, found.homing_offset)
    by = shifted.lower - needed.lower
    return JointCalibration(found.sign, round(zero) + by, offset, found.travel.lower + by, found.travel.upper + by)


def _range_needed(joint: Joint, found: Found, zero: float) -> Travel:
    """Everything that the servo must be able to say: its travel, and the URDF's range."""
    ends = [zero + found.sign * end / unit(joint) for end in (joint.limits.lower, joint.limits.upper)]
    return Travel(min(found.travel.lower, floor(min(ends))), max(found.travel.upper, ceil(max(ends))))


def _off_the_seam(joint: Joint, needed: Travel, offset: int | None) -> tuple[Travel, int | None]:
    """The range as the servo says it where that does not cross the seam, and the homing offset for it."""
    turn = joint.model.counts_per_turn
    turns = needed.lower // turn * turn
    here = Travel(needed.lower - turns, needed.upper - turns)
    margin = min(SEAM_MARGIN_COUNTS, max(0, (turn - needed.span) // 4))
    if here.lower >= margin and here.upper < turn - margin:
        return here, offset
    if offset is None or abs(offset) > LARGEST_OFFSET:
        raise CalibrationError(
            f"{joint.name}: its servo ({joint.servo_id}) passes from its last count to its first within the joint's "
            f"range, and a {joint.model.name} cannot move that place: take the horn off, turn the servo to its middle, "
            "put it on again"
        )
    try:
        new = offset_for_travel(needed, offset, turn)
    except ValueError as error:
        raise CalibrationError(f"{joint.name}: {error}: are its limits in the URDF right?") from error
    return moved(needed, offset, new, turn), new


def doubts(joint: Joint, calibration: JointCalibration) -> str:
    """The doubts about the travel in a sentence; empty where there are none."""
    travel, range_ = calibration.travel(joint), joint.limits.upper - joint.limits.lower
    share = travel / range_ - 1.0
    if share < SWEPT_SHARE - 1.0:
        return f"was moved through {travel:.3f} of {range_:.3f} in the URDF: not from stop to stop"
    if abs(share) > DOUBTFUL_SHARE:
        return (
            f"its travel is {travel:.3f}, the URDF's {range_:.3f}: {share:+.1%}. "
            "Was a stop missed, or is a part another?"
        )
    return ""
