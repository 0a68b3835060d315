"""First goal of a joint whose torque is being enabled: its measured position, if the joint may be driven from there."""

from typing import Final

from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.servos.servo_setup import ServoSetup
from hal.types import far_outside

AMBIGUOUS_SHARE: Final = 0.25
"""Fraction of the range outside the limits of a joint, from each limit, that is clearly nearer to this limit."""


def start_goal(joint: Joint, counts: int, called: str, setup: ServoSetup, limp: bool) -> int:
    """Return the measured position of a joint as its first goal.

    If something pushes a driven servo in extended position mode past the end of its turn, its goal becomes this end,
    because a later activation determines the turn of a servo from its goal.

    Args:
        joint: The joint.
        counts: Measured position, in counts.
        called: Name of the joint in error messages.
        setup: Access to the settings of the servo.
        limp: Whether the torque of the servo is known to be disabled.

    Returns:
        The goal, in counts.

    Raises:
        ActivationError: The joint is too far outside its limits, may be beyond either of them, or is outside the
            servo's own limits.
    """
    position = joint.position(counts)
    if problem := far_outside(position, joint.limits):
        advice = counted_turns(joint, counts) or (
            "Move the joint by hand, or calibrate the arm with 'servoloop calibrate' (or correct zero_counts)"
        )
        raise ActivationError(f"not activated: {called} {problem}. {advice}")
    if joint.limits.lower <= position <= joint.limits.upper:
        return counts
    if limp and (problem := _beyond_either_limit(joint, position)):
        raise ActivationError(f"not activated: {called} {problem}")
    own = setup.position_limits(joint)
    if own is None:
        return min(max(counts, 0), joint.model.last_count) if series_of(joint.model) is X else counts
    # A servo outside its own limits moves back to them as soon as its torque is enabled. For positions within the joint
    # limits, this was already checked during setup.
    if not own[0] <= counts <= own[1]:
        raise ActivationError(
            f"not activated: {called} is at {counts} counts, outside the servo's own limits {own[0]} to {own[1]}, so "
            "the servo would jump to the nearer limit. Move the joint by hand, or widen the servo's limits"
        )
    return counts


def _beyond_either_limit(joint: Joint, position: float) -> str:
    """Return a message if a limp joint outside its limits may have been turned beyond either of them.

    The encoder reports only the position within one turn. If almost a whole turn is within the limits, a position
    between them can be beyond the upper or the lower limit. A wrong choice would drive the joint into a stop.
    """
    turn = abs(joint.units_per_count) * joint.model.counts_per_turn
    lower, upper = joint.limits.lower, joint.limits.upper
    outside = max(lower - position, position - upper)
    if joint.seam_inside or joint.model.positions is not None or outside <= AMBIGUOUS_SHARE * (turn - upper + lower):
        return ""
    return (
        f"is at {position:.4f}, which can be beyond its upper limit {upper:g} or beyond its lower limit {lower:g}. "
        "Move the joint into its limits by hand"
    )


def counted_turns(joint: Joint, counts: int) -> str:
    """Explain a reading that is outside the servo's range by whole turns. For any other reading, the explanation is
    empty."""
    if not (turns := joint.turns(counts)):
        return ""
    number = "a turn" if abs(turns) == 1 else f"{abs(turns)} turns"
    return (
        f"The servo reports {counts} counts, which is outside 0 to {joint.model.last_count}: it has counted {number}. "
        "Hold the arm, and switch the servos' supply off and on. Do not change zero_counts, because the new value "
        "would be wrong afterwards"
    )
