"""The blocks of the cycle, all registers of one servo at once: goals to bytes, bytes to states.

Offsets and formats are computed once; a cycle then unpacks whole bursts.
"""

from collections.abc import Iterable, Mapping
from functools import lru_cache
from itertools import repeat
from struct import Struct
from typing import Final

from drivers.bus import ServoGoal, ServoState
from drivers.dynamixel import wire
from drivers.dynamixel.crc import crc16
from drivers.dynamixel.models import X
from drivers.dynamixel.series import Series, StateBlock
from drivers.readings import Outcome

UnitsA = Iterable[float | None]
"""What one unit of each servo's current is, in the order of the question; None for one that measures none."""
NO_CURRENT: Final = repeat(None)

_Layout = tuple[Struct, int, tuple[int, ...], tuple[tuple[slice, int], ...]]


@lru_cache(maxsize=64)
def _layout(servo_ids: tuple[int, ...], block: StateBlock) -> _Layout:
    """How a whole burst is taken apart.

    How many numbers each reply has (its head as one, the error byte, the state's, the checksum), each reply's
    head, and for each reply which bytes its checksum goes over and where in the numbers it is.
    """
    size, fields = block.size, block.fields
    burst = Struct("<" + f"QB{size - fields.size}x{fields.format[1:]}H" * len(servo_ids))
    numbers = len(burst.unpack(bytes(burst.size))) // max(len(servo_ids), 1)
    heads = [wire.HEADER + bytes((i,)) + (size + 4).to_bytes(2, "little") + bytes((wire.STATUS,)) for i in servo_ids]
    length = size + wire.OVERHEAD
    checks = tuple((slice(n * length, (n + 1) * length - 2), (n + 1) * numbers - 1) for n in range(len(servo_ids)))
    return burst, numbers, tuple(int.from_bytes(head, "little") for head in heads), checks


def burst(
    data: bytes, servo_ids: tuple[int, ...], block: StateBlock, units_a: UnitsA = NO_CURRENT
) -> dict[int, ServoState] | None:
    """All states where ``data`` is exactly the replies of all servos in their order; None otherwise.

    None too where a reply is stuffed, has an error number, or does not prove what it is.
    """
    layout, step, heads, checks = _layout(servo_ids, block)
    if len(data) != layout.size or data.count(wire.PATTERN) != len(servo_ids):
        return None
    numbers = layout.unpack(data)
    if numbers[::step] != heads:
        return None
    errors = numbers[1::step]
    if any(errors) and any(error & ~wire.ALERT for error in errors):
        return None
    for covered, check in checks:
        if crc16(data[covered]) != numbers[check]:
            return None
    columns = [numbers[column::step] for column in range(2, step - 1)]
    for place, value in block.proof:
        if columns[place].count(value) != len(servo_ids):
            return None
    return dict(zip(servo_ids, map(block.state, units_a, errors, *columns), strict=True))


@lru_cache(maxsize=64)
def _fast_layout(servo_ids: tuple[int, ...], block: StateBlock) -> tuple[bytes, Struct, int]:
    """A fast sync read's reply: its head, how it is taken apart, and how many numbers each piece has."""
    pieces = f"BB{block.size - block.fields.size}x{block.fields.format[1:]}H" * len(servo_ids)
    layout = Struct(f"<{wire.FAST_HEAD_SIZE}x{pieces}")
    numbers = len(layout.unpack(bytes(layout.size))) // max(len(servo_ids), 1)
    return wire.fast_head(len(servo_ids), block.size), layout, numbers


def fast_whole(
    data: bytes, servo_ids: tuple[int, ...], block: StateBlock, units_a: UnitsA = NO_CURRENT
) -> dict[int, ServoState] | None:
    """All states where ``data`` is exactly the reply of all servos to a fast sync read; None otherwise.

    The last checksum goes over the whole packet: those of the pieces before need no look.
    """
    head, layout, step = _fast_layout(servo_ids, block)
    if len(data) != layout.size or not data.startswith(head):
        return None
    numbers = layout.unpack(data)
    errors = numbers[::step]
    if numbers[1::step] != servo_ids or (any(errors) and any(error & ~wire.ALERT for error in errors)):
        return None
    if crc16(data[:-2]) != numbers[-1]:
        return None
    columns = [numbers[column::step] for column in range(2, step - 1)]
    for place, value in block.proof:
        if columns[place].count(value) != len(servo_ids):
            return None
    return dict(zip(servo_ids, map(block.state, units_a, errors, *columns), strict=True))


def fast_outcome(
    data: bytes, servo_ids: tuple[int, ...], block: StateBlock, units_a: UnitsA = NO_CURRENT
) -> dict[int, Outcome]:
    """What a fast sync read's one reply says, up to the first servo that cannot be believed.

    Each servo's piece ends in a checksum of all that was sent before, so a piece is as sure as a packet.
    ``data`` begins with the reply's head. Nothing is stuffed in such a reply.
    """
    outcome: dict[int, Outcome] = {}
    piece = block.size + wire.FAST_OVERHEAD
    if not data.startswith(wire.fast_head(len(servo_ids), block.size)):
        return outcome
    value, done = 0, 0
    for n, (servo_id, unit_a) in enumerate(zip(servo_ids, units_a, strict=False)):
        at = wire.FAST_HEAD_SIZE + n * piece
        end = at + piece
        if len(data) < end or data[at + 1] != servo_id:
            break
        value = crc16(data[done : end - 2], value)
        if value != int.from_bytes(data[end - 2 : end], "little"):
            break
        done = end - 2
        outcome[servo_id] = block.outcome(servo_id, data[at], data[at + 2 : done], unit_a)
    return outcome


def goals_packet(goals: Mapping[int, ServoGoal], series: Series = X) -> bytes:
    """One sync write with a goal for each servo. Raises ValueError where one does not fit."""
    return wire.sync_write(series.goal_address, series.goal_size, {i: series.goal(g) for i, g in goals.items()})
