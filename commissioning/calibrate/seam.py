"""The seam of a servo's encoder, where it passes from its last count to its first, and how it is moved.

An STS subtracts its homing offset from what the encoder reads. A Dynamixel X adds it, and obeys it at any size only in
extended position mode. There it counts on over turns, and the bus keeps the place within one (drivers/bus/turns.py).
"""

from dataclasses import dataclass
from functools import partial
from typing import Final

from calibration.angles import LARGEST_OFFSET, Travel, moved, new_offset, offset_for_travel
from calibration.eeprom import Change, update
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.servos import x
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from drivers.servos.register import Register, ServoModel
from hal.joint import Joint

SEAM_MARGIN_COUNTS: Final = 16
"""Distance that a travel keeps from the seam: gears bend a little beyond their stops."""


@dataclass(frozen=True, slots=True)
class Counting:
    """What a servo's counts depend on."""

    homing_offset: int | None
    """What the register holds; None: the servo has none that counts."""
    extended: bool = False
    """Whether a Dynamixel X is in extended position mode."""

    def seam(self, model: ServoModel) -> int | None:
        """What the encoder reads where the servo reports 0; None where that cannot be moved."""
        if self.homing_offset is None or not can_move_seam(model):
            return None
        if series_of(model) is not X:
            return self.homing_offset
        obeyed = self.extended or abs(self.homing_offset) <= x.LARGEST_OFFSET_OF_POSITION_MODE
        return -self.homing_offset if obeyed else 0


def joint_counting(joint: Joint) -> Counting:
    """How the joint's servo counts, by the robot file or its calibration."""
    return Counting(joint.homing_offset or 0, joint.extended)


def homing_register(model: ServoModel) -> Register | None:
    """The register of the servo's homing offset; None where it has none."""
    return next((one for one in series_of(model).registers if one.name == "homing_offset"), None)


def can_move_seam(model: ServoModel) -> bool:
    """Return whether the place where the servo's counts begin can be set."""
    return homing_register(model) is not None


def counting_of(bus: Bus, joint: Joint) -> Counting:
    """How the joint's servo counts now. Raises ServoError."""
    register = homing_register(joint.model)
    if register is None:
        return Counting(None)
    offset = retry(partial(bus.read, joint.servo_id, register))
    return Counting(offset, series_of(joint.model) is X and is_extended(bus, joint))


def is_extended(bus: Bus, joint: Joint) -> bool:
    """Whether the joint's Dynamixel X is in extended position mode. Raises ServoError."""
    return retry(partial(bus.read, joint.servo_id, x.operating_mode)) == x.EXTENDED_POSITION_MODE


def write_counting(bus: Bus, joint: Joint, wanted: Counting) -> tuple[Change, ...]:
    """Have the joint's servo, whose torque is off, count like this; what had to be written. Raises ServoError."""
    register, series = homing_register(joint.model), series_of(joint.model)
    if register is None or wanted.homing_offset is None:
        return ()
    values = {register: wanted.homing_offset}
    if series is X:
        values[x.operating_mode] = x.EXTENDED_POSITION_MODE if wanted.extended else x.POSITION_MODE
    return update(bus, joint.servo_id, series.lock, values)


def off_the_seam(model: ServoModel, needed: Travel, counting: Counting) -> tuple[Travel, Counting] | None:
    """A range as the servo reports it where that does not cross the seam, and how it must count for that.

    ``needed``: continuous counts as the servo reports them now; a range of up to a turn. None where the servo cannot
    move its seam.
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
    if whole and shifted.lower > turn // 2:  # it begins a count before the turn does
        shifted = Travel(shifted.lower - turn, shifted.upper - turn)
    return shifted, Counting(new) if series_of(model) is not X else Counting(-new, extended=True)


def _as_it_is(model: ServoModel, needed: Travel, counting: Counting) -> Travel | None:
    """The range as the servo reports it now; None where it crosses the seam."""
    turn, offset = model.counts_per_turn, counting.homing_offset
    if offset is not None and abs(offset) > LARGEST_OFFSET:
        return None
    here = _clear(needed, 0, turn)
    if series_of(model) is not X or counting.extended or here is None:
        return here
    # In position mode the encoder's own turn counts too: the servo reports the place in it, plus the offset.
    added = -(counting.seam(model) or 0)
    raw = _clear(needed, added, turn)
    return here if raw is not None and raw.lower + added == here.lower else None


def _clear(needed: Travel, added: int, turn: int) -> Travel | None:
    """The range less ``added`` within one turn; None where it crosses from one into the next."""
    lower = (needed.lower - added) % turn
    margin = min(SEAM_MARGIN_COUNTS, max(0, (turn - needed.span) // 4))
    inside = lower >= margin and lower + needed.span < turn - margin
    return Travel(lower, lower + needed.span) if inside else None
