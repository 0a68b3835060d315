"""The blocks of the cycle, all registers of one servo at once: goals to bytes, bytes to states.

Offsets, formats and signs are computed once from the table; a cycle then unpacks whole bursts.
"""

from collections.abc import Mapping
from functools import lru_cache
from struct import Struct
from typing import Final
from zlib import adler32

from drivers.bus import ServoGoal, ServoState
from drivers.feetech import sts, wire
from drivers.registers import Register

_FORMATS: Final = {1: "B", 2: "H"}
_ORDER: Final = "little"

STATE_ADDRESS: Final = sts.STATE_BLOCK[0].address
STATE_SIZE: Final = sum(register.size for register in sts.STATE_BLOCK)
STATE_SIZES: Final = (STATE_SIZE, STATE_SIZE + 2, STATE_SIZE + 5, STATE_SIZE + 7)
"""What may be read instead, see drivers.owed. All begin with the state block and end within the table. Their
length bytes differ in two bits at least: no single flipped bit turns one into another."""
GOAL_ADDRESS: Final = sts.GOAL_BLOCK[0].address
GOAL_SIZE: Final = sum(register.size for register in sts.GOAL_BLOCK)

_STATE: Final = "".join(_FORMATS[register.size] for register in sts.STATE_BLOCK)
assert GOAL_SIZE == 7, "a goal and its servo's ID are eight bytes"
_POSITION_AT: Final = 8 * (1 + sts.goal_position.address - GOAL_ADDRESS)
_VELOCITY_AT: Final = 8 * (1 + sts.goal_velocity.address - GOAL_ADDRESS)
"""Bits behind the ID, which is the lowest byte."""

# Every answer that a narrow register can give, looked up instead of calculated.
_ALARMS: Final = tuple(sts.alarms(status) for status in range(256))
_LOADS: Final = tuple(
    sts.present_load.decode(raw.to_bytes(2, _ORDER), _ORDER) * sts.TORQUE_UNIT for raw in range(1 << 11)
)
_VOLTAGES_V: Final = tuple(raw * sts.VOLTAGE_UNIT_V for raw in range(256))
_TEMPERATURES_C: Final = tuple(float(raw) for raw in range(256))
_SIGN: Final = 1 << 15
assert {sts.present_position.sign_bit, sts.present_velocity.sign_bit, sts.goal_position.sign_bit} == {15}
assert sts.present_load.sign_bit == 10


def state(status: int, data: bytes) -> ServoState:
    """The state in one reply; ``data`` may be longer than the block."""
    position, velocity, load, voltage, temperature = _ONE.unpack_from(data)
    return ServoState(
        position if position < _SIGN else _SIGN - position,
        velocity if velocity < _SIGN else _SIGN - velocity,
        _LOADS[load & 0x7FF],
        _VOLTAGES_V[voltage],
        _TEMPERATURES_C[temperature],
        _ALARMS[status],
    )


_ONE: Final = Struct("<" + _STATE)
_new: Final = tuple.__new__
_HEADER: Final = int.from_bytes(wire.HEADER, "little")

_GOOD_SUM: Final = (wire.HEADER[0] + wire.HEADER[1] + 0xFF + 1) & 0xFF
"""Of a whole reply by Adler-32, whose lower half is the sum of all bytes and 1: the checksum makes the sum after the
header 255. Summing in C by a function for something else takes half the time of ``sum``."""


_CHECKSUMS: Final = tuple(bytes((~(total - 1 - sum(wire.HEADER)) & 0xFF,)) for total in range(256))
"""By the lowest byte of the Adler-32 of what is before it."""


@lru_cache(maxsize=8)
def _frame(size: int) -> Struct:
    """A whole reply: header, ID, length, status, the block, what is behind it, checksum."""
    return Struct("<" + f"HBBB{_STATE}{size - STATE_SIZE}xB")


def burst(data: bytes, servo_ids: tuple[int, ...], size: int) -> dict[int, ServoState] | None:
    """All states where ``data`` is exactly the replies of all servos in their order; None otherwise.

    ``state`` once more, written out: this is the greater part of a cycle's Python. What it looks at has been forgotten
    by the processor since the last cycle, so a small table read seven times is better than a large one read once.
    """
    frame_size = size + wire.OVERHEAD
    if len(data) != frame_size * len(servo_ids):
        return None
    states: dict[int, ServoState] = {}
    begin = 0
    for servo_id, numbers in zip(servo_ids, _frame(size).iter_unpack(data), strict=True):
        header, replied, length, status, position, velocity, load, voltage, temperature, _ = numbers
        end = begin + frame_size
        if header != _HEADER or replied != servo_id or length != size + 2:
            return None
        if adler32(data[begin:end]) & 0xFF != _GOOD_SUM:
            return None
        begin = end
        fields = (
            position if position < _SIGN else _SIGN - position,
            velocity if velocity < _SIGN else _SIGN - velocity,
            _LOADS[load & 0x7FF],
            _VOLTAGES_V[voltage],
            _TEMPERATURES_C[temperature],
            _ALARMS[status],
            None,
        )
        states[servo_id] = _new(ServoState, fields)
    return states


@lru_cache(maxsize=64)
def _goals_layout(count: int) -> tuple[Struct, bytes]:
    """So many goals, each one number of eight bytes, and the packet's beginning."""
    size = (GOAL_SIZE + 1) * count
    head = wire.HEADER + bytes((wire.BROADCAST_ID, size + 4, wire.SYNC_WRITE, GOAL_ADDRESS, GOAL_SIZE))
    return Struct(f"<{count}Q"), head


def goals_packet(goals: Mapping[int, ServoGoal]) -> bytes:
    """One sync write with a goal for each servo. Raises ValueError where one does not fit.

    Acceleration 0, no ramp of the servo's own: the trajectory above is smooth already, and a ramp
    would stop the servo at every goal.
    """
    layout, head = _goals_layout(len(goals))
    numbers: list[int] = []
    for servo_id, goal in goals.items():
        position, velocity = goal.position_counts, goal.velocity_counts_s
        if not (0 <= position < _SIGN and 0 <= velocity < _SIGN):
            position = _raw(sts.goal_position, position)
            velocity = _raw(sts.goal_velocity, velocity)
        numbers.append(servo_id | position << _POSITION_AT | velocity << _VELOCITY_AT)
    packet = head + layout.pack(*numbers)
    return packet + _CHECKSUMS[adler32(packet) & 0xFF]


def _raw(register: Register, value: int) -> int:
    """The bits of a value that has a sign, or the complaint that it does not fit."""
    return int.from_bytes(register.encode(value, _ORDER), _ORDER)
