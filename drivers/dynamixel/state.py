"""The blocks of the cycle, all registers of one servo at once: goals to bytes, bytes to states.

Offsets and formats are computed once; a cycle then unpacks whole bursts.
"""

from collections.abc import Mapping
from functools import lru_cache
from struct import Struct
from typing import Final

from drivers.bus import ServoGoal, ServoState
from drivers.dynamixel import wire
from drivers.dynamixel.crc import WORDS, crc16
from drivers.dynamixel.models import Series, X, profile_units

__all__ = ["STATE_SIZE", "burst", "fast_burst", "fast_whole", "goals_packet", "profile_units", "state"]

STATE_SIZE: Final = X.state_sizes[0]

_PER_FRAME: Final = 8
"""Numbers in one reply: its head as one, the error byte, the five registers, the checksum."""
_HEAD_SIZE: Final = 8
"""Header, ID, length and instruction."""


def state(error: int, data: bytes, series: Series = X) -> ServoState:
    """The state at the end of one reply's data; a longer block begins earlier."""
    fields = series.fields
    return series.state(error, *fields.unpack_from(data, len(data) - fields.size))


_Layout = tuple[Struct, tuple[int, ...], Struct, list[tuple[int, int, int]]]


@lru_cache(maxsize=64)
def _layout(servo_ids: tuple[int, ...], size: int, series: Series) -> _Layout:
    """How a whole burst is taken apart, each reply's head, the words of one reply that its checksum goes over,
    and for each reply where these begin, the checksum of what is before them, and where in the numbers its own is."""
    lead = size - series.fields.size
    burst = Struct("<" + f"QB{lead}x{series.fields.format[1:]}H" * len(servo_ids))
    heads = [wire.HEADER + bytes((i,)) + (size + 4).to_bytes(2, "little") + bytes((wire.STATUS,)) for i in servo_ids]
    # Words, so an even number of bytes: where the error byte and the data are an odd one, the head's last too.
    behind = _HEAD_SIZE - (size + 1) % 2
    words = Struct(f">{(size + 2) // 2}H")
    checks = [
        (n * (size + wire.OVERHEAD) + behind, crc16(head[:behind]), (n + 1) * _PER_FRAME - 1)
        for n, head in enumerate(heads)
    ]
    return burst, tuple(int.from_bytes(head, "little") for head in heads), words, checks


def burst(data: bytes, servo_ids: tuple[int, ...], size: int, series: Series = X) -> dict[int, ServoState] | None:
    """All states where ``data`` is exactly the replies of all servos in their order; None otherwise.

    None too where a reply is stuffed, or has an error number.
    """
    layout, heads, words, checks = _layout(servo_ids, size, series)
    if len(data) != layout.size or data.count(wire.PATTERN) != len(servo_ids):
        return None
    numbers = layout.unpack(data)
    if numbers[::_PER_FRAME] != heads:
        return None
    errors = numbers[1::_PER_FRAME]
    if any(errors) and any(error & ~wire.ALERT for error in errors):
        return None
    table, words_at = WORDS, words.unpack_from
    for at, value, check in checks:
        for word in words_at(data, at):
            value = table[value ^ word]
        if value != numbers[check]:
            return None
    columns = (numbers[column::_PER_FRAME] for column in range(1, _PER_FRAME - 1))
    return dict(zip(servo_ids, map(series.state, *columns), strict=True))


@lru_cache(maxsize=64)
def _fast_layout(servo_ids: tuple[int, ...], size: int, series: Series) -> tuple[bytes, Struct]:
    """A fast sync read's reply: its head, and how it is taken apart."""
    lead = size - series.fields.size
    pieces = f"BB{lead}x{series.fields.format[1:]}H" * len(servo_ids)
    return wire.fast_head(len(servo_ids), size), Struct(f"<{wire.FAST_HEAD_SIZE}x{pieces}")


def fast_whole(data: bytes, servo_ids: tuple[int, ...], size: int, series: Series = X) -> dict[int, ServoState] | None:
    """All states where ``data`` is exactly the reply of all servos to a fast sync read; None otherwise.

    The last checksum goes over the whole packet: those of the pieces before need no look.
    """
    head, layout = _fast_layout(servo_ids, size, series)
    if len(data) != layout.size or not data.startswith(head):
        return None
    numbers = layout.unpack(data)
    errors = numbers[::_PER_FRAME]
    if numbers[1::_PER_FRAME] != servo_ids or (any(errors) and any(error & ~wire.ALERT for error in errors)):
        return None
    if crc16(data[:-2]) != numbers[-1]:
        return None
    columns = (numbers[column::_PER_FRAME] for column in range(2, _PER_FRAME - 1))
    return dict(zip(servo_ids, map(series.state, errors, *columns), strict=True))


def fast_burst(data: bytes, servo_ids: tuple[int, ...], size: int, series: Series = X) -> dict[int, ServoState]:
    """The states of a fast sync read's one reply, up to the first servo that cannot be believed.

    Each servo's piece ends in a checksum of all that was sent before, so a piece is as sure as a packet.
    ``data`` begins with the reply's head. Nothing is stuffed in such a reply.
    """
    states: dict[int, ServoState] = {}
    piece = size + wire.FAST_OVERHEAD
    if not data.startswith(wire.fast_head(len(servo_ids), size)):
        return states
    value, done = 0, 0
    for n, servo_id in enumerate(servo_ids):
        at = wire.FAST_HEAD_SIZE + n * piece
        end = at + piece
        if len(data) < end or data[at + 1] != servo_id or data[at] & ~wire.ALERT:
            return states
        value = crc16(data[done : end - 2], value)
        if value != int.from_bytes(data[end - 2 : end], "little"):
            return states
        done = end - 2
        states[servo_id] = state(data[at], data[at + 2 : end - 2], series)
    return states


def goals_packet(goals: Mapping[int, ServoGoal], series: Series = X) -> bytes:
    """One sync write with a goal for each servo. Raises ValueError where one does not fit."""
    return wire.sync_write(series.goal_address, series.goal_size, {i: series.goal(g) for i, g in goals.items()})
