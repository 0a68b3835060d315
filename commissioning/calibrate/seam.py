"""Move the seam of a servo's encoder, where the count jumps from the last value to the first.

An STS subtracts its homing offset from the encoder reading. A Dynamixel X adds the offset, and accepts arbitrary
offsets only in extended position mode. In this mode, the servo counts multiple turns, and the bus reduces its counts to
one turn (drivers/bus/turns.py).
"""

from dataclasses import dataclass
from functools import partial
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.eeprom import Change, update
from drivers.servos import x
from drivers.servos.angles import LARGEST_OFFSET, Travel, moved, new_offset, offset_for_travel
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from drivers.servos.register import Register, ServoModel
from hal.joint import Joint

SEAM_MARGIN_COUNTS: Final = 16
"""Minimum distance between a travel and the seam, in counts, because gears flex slightly at the stops."""


@dataclass(frozen=True, slots=True)
class Counting:
    """Settings of a servo that determine its counts."""

    homing_offset: int | None
    """Value of the homing offset register; None if the servo has no usable homing offset."""
    extended: bool = False
    """Whether a Dynamixel X is in extended position mode."""

    def seam(self, model: ServoModel) -> int | None:
        """Return the encoder reading at which the servo reports 0, or None if this reading cannot be changed."""
        if self.homing_offset is None or not can_move_seam(model):
            return None
        if series_of(model) is not X:
            return self.homing_offset
        obeyed = self.extended or not x.needs_extended_position(self.homing_offset)
        return -self.homing_offset if obeyed else 0


def joint_counting(joint: Joint) -> Counting:
    """Return the settings that determine the counts of the joint's servo, from the robot file or its calibration."""
    return Counting(joint.homing_offset or 0, joint.extended)


def homing_register(model: ServoModel) -> Register | None:
    """Return the homing offset register of a servo model; None if the model does not have one."""
    return next((one for one in series_of(model).registers if one.name == "homing_offset"), None)


def can_move_seam(model: ServoModel) -> bool:
    """Return whether the seam of this servo model can be moved."""
    return homing_register(model) is not None


def counting_of(bus: Bus, joint: Joint) -> Counting:
    """Read the current settings that determine the counts of the joint's servo. Raises ServoError."""
    register = homing_register(joint.model)
    if register is None:
        return Counting(None)
    offset = retry(partial(bus.read, joint.servo_id, register))
    return Counting(offset, series_of(joint.model) is X and is_extended(bus, joint))


def is_extended(bus: Bus, joint: Joint) -> bool:
    """Return whether the joint's servo is a Dynamixel X in a mode that counts turns. Raises ServoError."""
    return retry(partial(bus.read, joint.servo_id, x.operating_mode)) in x.MODES_WITH_TURNS


def write_counting(bus: Bus, joint: Joint, wanted: Counting) -> tuple[Change, ...]:
    """Write these settings to the joint's servo and return the changes. Torque must be off. Raises ServoError."""
    register, series = homing_register(joint.model), series_of(joint.model)
    if register is None or wanted.homing_offset is None:
        return ()
    values = {register: wanted.homing_offset}
    if series is X:
        values[x.operating_mode] = x.EXTENDED_POSITION_MODE if wanted.extended else x.POSITION_MODE
    return update(bus, joint.servo_id, series.lock, values)


def off_the_seam(model: ServoModel, needed: Travel, counting: Counting) -> tuple[Travel, Counting] | None:
    """Return a range in counts that does not cross the seam, and the servo settings for these counts.

    Args:
        model: Model of the servo.
        needed: Range of at most one turn, in continuous counts as the servo currently reports them.
        counting: Current settings of the servo.

    Returns:
        The range and the settings; None if the range crosses the seam and the seam of this servo cannot be moved.
    """
    turn = model.counts_per_turn
    if (here := _as_it_is(model, needed, counting)) is not None:
        return here, counting
    seam = counting.seam(model)
    if seam is None:
        return None
    whole = needed.span > turn - 2
    middle = (needed.lower + needed.upper) // 2
    new = new_offset(middle, seam, turn // 2, turn) if whole else offset_for_travel(needed, seam, turn)
    shifted = moved(needed, seam, new, turn)
    if whole and shifted.lower > turn // 2:  # The range begins one count before the turn.
        shifted = Travel(shifted.lower - turn, shifted.upper - turn)
    return shifted, Counting(new) if series_of(model) is not X else Counting(-new, extended=True)


def _as_it_is(model: ServoModel, needed: Travel, counting: Counting) -> Travel | None:
    """Return the range in the counts that the servo currently reports; None if it crosses the seam."""
    turn, offset = model.counts_per_turn, counting.homing_offset
    if offset is not None and abs(offset) > LARGEST_OFFSET:
        return None
    here = _clear(needed, 0, turn)
    if series_of(model) is not X or counting.extended or here is None:
        return here
    # In position mode, the servo reports the encoder's position within its turn, plus the offset.
    added = -(counting.seam(model) or 0)
    raw = _clear(needed, added, turn)
    return here if raw is not None and raw.lower + added == here.lower else None


def _clear(needed: Travel, added: int, turn: int) -> Travel | None:
    """Return the range minus ``added``, within one turn; None if the result crosses into the next turn."""
    lower = (needed.lower - added) % turn
    margin = min(SEAM_MARGIN_COUNTS, max(0, (turn - needed.span) // 4))
    inside = lower >= margin and lower + needed.span < turn - margin
    return Travel(lower, lower + needed.span) if inside else None
