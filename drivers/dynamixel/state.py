"""The blocks of the cycle, all registers of one servo at once: goals to bytes, bytes to states.

Offsets and formats are computed once; a cycle then unpacks whole bursts.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from struct import Struct
from typing import Final

from drivers.bus import ServoGoal, ServoState
from drivers.dynamixel import wire, x_series
from drivers.dynamixel.crc import WORDS, crc16
from drivers.registers import Register

STATE_SIZE: Final = x_series.STATE_BLOCK_END - x_series.STATE_BLOCK_ADDRESS
GOAL_ADDRESS: Final = x_series.GOAL_BLOCK[0].address
GOAL_SIZE: Final = sum(register.size for register in x_series.GOAL_BLOCK)
LARGEST_PROFILE: Final = 32767

ALARMED: Final = ("hardware error",)
"""What the alert bit says by itself. Which error it is stands in a register outside the block."""

_STATE: Final = "h2xii8xHB"
"""PWM, velocity, position, voltage, temperature; between them what is current in one model and load in another,
and the trajectory."""
_ONE: Final = Struct("<" + _STATE)
assert _ONE.size == STATE_SIZE
_VOLTAGES_V: Final = tuple(raw * x_series.VOLTAGE_UNIT_V for raw in range(256))
_PER_FRAME: Final = 8
"""Numbers in one reply: its head as one, the error byte, the five registers, the checksum."""
_HEAD_SIZE: Final = 8
"""Header, ID, length and instruction."""
_new: Final = tuple.__new__


def state(error: int, data: bytes) -> ServoState:
    """The state at the end of one reply's data; a longer block begins earlier."""
    return _state(error, *_ONE.unpack_from(data, len(data) - STATE_SIZE))


def _state(error: int, pwm: int, velocity: int, position: int, voltage: int, temperature: int) -> ServoState:
    fields = (
        position,
        round(velocity * x_series.VELOCITY_UNIT_COUNTS_S),
        pwm / x_series.FULL_PWM,
        _VOLTAGES_V[voltage] if voltage < 256 else voltage * x_series.VOLTAGE_UNIT_V,
        float(temperature),
        ALARMED if error & wire.ALERT else (),
    )
    return _new(ServoState, fields)


_Layout = tuple[Struct, tuple[int, ...], Struct, list[tuple[int, int, int]]]


@lru_cache(maxsize=64)
def _layout(servo_ids: tuple[int, ...], size: int) -> _Layout:
    """How a whole burst is taken apart, each reply's head, the words of one reply behind its head, and
    for each reply where these begin, the checksum of its head, and where in the numbers its own is."""
    burst = Struct("<" + f"QB{size - STATE_SIZE}x{_STATE}H" * len(servo_ids))
    heads = [wire.HEADER + bytes((i,)) + (size + 4).to_bytes(2, "little") + bytes((wire.STATUS,)) for i in servo_ids]
    words = Struct(f">{(size + 1) // 2}H")
    checks = [
        (n * (size + wire.OVERHEAD) + _HEAD_SIZE, crc16(head), (n + 1) * _PER_FRAME - 1) for n, head in enumerate(heads)
    ]
    return burst, tuple(int.from_bytes(head, "little") for head in heads), words, checks


def burst(data: bytes, servo_ids: tuple[int, ...], size: int) -> dict[int, ServoState] | None:
    """All states where ``data`` is exactly the replies of all servos in their order; None otherwise.

    None too where a reply is stuffed, or has an error number. ``size`` is odd, as all blocks are.
    """
    layout, heads, words, checks = _layout(servo_ids, size)
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
    return dict(zip(servo_ids, map(_state, *columns), strict=True))


def profile_units(velocity_counts_s: int) -> int:
    """A speed as profile_velocity, rounded up: the servo is never slower than asked. 0 stays 0."""
    return min(math.ceil(velocity_counts_s / x_series.VELOCITY_UNIT_COUNTS_S), LARGEST_PROFILE)


def goals_packet(goals: Mapping[int, ServoGoal]) -> bytes:
    """One sync write with a goal for each servo. Raises ValueError where one does not fit."""
    return wire.sync_write(GOAL_ADDRESS, GOAL_SIZE, {i: _goal_bytes(goal) for i, goal in goals.items()})


_GOAL: Final = Struct("<Ii")
_MANY: Final = 1 << 31


def _goal_bytes(goal: ServoGoal) -> bytes:
    velocity, position = profile_units(goal.velocity_counts_s), goal.position_counts
    if velocity >= 0 and -_MANY <= position < _MANY:
        return _GOAL.pack(velocity, position)
    return _refused(x_series.GOAL_BLOCK[0], velocity) + _refused(x_series.GOAL_BLOCK[1], position)


def _refused(register: Register, value: int) -> bytes:
    """The complaint that a value does not fit, in the register's own words."""
    return register.encode(value, "little")
