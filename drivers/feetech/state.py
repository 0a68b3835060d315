"""The blocks of the cycle, all registers of one servo at once: goals to bytes, bytes to states.

Offsets, formats and signs are computed once from the table; a cycle then unpacks whole bursts.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from struct import Struct
from typing import Final

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
_MAGNITUDE: Final = _SIGN - 1
assert {sts.present_position.sign_bit, sts.present_velocity.sign_bit, sts.goal_position.sign_bit} == {15}
assert sts.present_load.sign_bit == 10


def state(status: int, data: bytes) -> ServoState:
    """The state in one reply; ``data`` may be longer than the block."""
    position, velocity, load, voltage, temperature = _ONE.unpack_from(data)
    return ServoState(
        _signed(position),
        _signed(velocity),
        _LOADS[load & 0x7FF],
        _VOLTAGES_V[voltage],
        _TEMPERATURES_C[temperature],
        _ALARMS[status],
    )


def _signed(raw: int) -> int:
    return raw if raw < _SIGN else _SIGN - raw


_ONE: Final = Struct("<" + _STATE)
_new: Final = tuple.__new__
_GOOD_SUM: Final = (sum(wire.HEADER) + 0xFF) & 0xFF
"""Of a whole reply: its checksum makes the sum after the header 255."""


class BurstLayout:
    """Where everything is in the replies of certain servos to one question.

    ``state`` once more, written out: this is the greater part of a cycle's Python. What it looks at has been forgotten
    by the processor since the last cycle, so few different steps done seven times are better than many done once, and
    a small table better than a large one.
    """

    __slots__ = ("_replies", "_unpack", "last_at", "last_head", "size")

    def __init__(self, servo_ids: tuple[int, ...], data_size: int) -> None:
        frame_size = data_size + wire.OVERHEAD
        self.size = frame_size * len(servo_ids)
        self.last_at = self.size - frame_size
        self.last_head = wire.HEADER + bytes(servo_ids[-1:])
        """Where so many bytes have this there, the last reply is their end: behind garbage its end would be to come."""
        # A whole reply: header, ID and length as one number, status, the block, what is behind it, checksum.
        self._unpack = Struct("<" + f"IB{_STATE}{data_size - STATE_SIZE}xB").unpack
        self._replies = tuple(
            (
                servo_id,
                int.from_bytes(wire.HEADER + bytes((servo_id, data_size + 2)), _ORDER),
                slice(turn * frame_size, (turn + 1) * frame_size),
            )
            for turn, servo_id in enumerate(servo_ids)
        )

    def states(self, data: bytes) -> tuple[dict[int, ServoState] | None, int]:
        """All states, and the bits of all alarms, where ``data`` is exactly the replies of all servos in their order.

        None for the states otherwise. ``data`` has ``size`` bytes.
        """
        states: dict[int, ServoState] = {}
        alarms = 0
        for servo_id, right_head, where in self._replies:
            reply = data[where]
            head, status, position, velocity, load, voltage, temperature, _ = self._unpack(reply)
            if head != right_head or sum(reply) & 0xFF != _GOOD_SUM:
                return None, 0
            if (position | velocity) & _SIGN:
                position, velocity = _signed(position), _signed(velocity)
            alarms |= status
            fields = (
                position,
                velocity,
                _LOADS[load & 0x7FF],
                _VOLTAGES_V[voltage],
                _TEMPERATURES_C[temperature],
                _ALARMS[status],
                None,
            )
            states[servo_id] = _new(ServoState, fields)
        return states, alarms


@lru_cache(maxsize=256)
def layout(servo_ids: tuple[int, ...], data_size: int) -> BurstLayout:
    """The layout of a burst, made once."""
    return BurstLayout(servo_ids, data_size)


def burst(data: bytes, servo_ids: tuple[int, ...], data_size: int) -> dict[int, ServoState] | None:
    """All states where ``data`` is exactly the replies of all servos in their order; None otherwise."""
    replies = layout(servo_ids, data_size)
    return replies.states(data)[0] if len(data) == replies.size else None


_GOALS_OVERHEAD: Final = 8
"""Header, ID, length, instruction, address, size, checksum."""
_MOST_GOALS: Final = (0xFF - 4) // (GOAL_SIZE + 1)
"""In one packet, whose length is a byte."""
_CHECKSUMS: Final = tuple(bytes((~(total - sum(wire.HEADER)) & 0xFF,)) for total in range(256))
"""By the lowest byte of the sum of what is before it, header included."""


def _goals_layout(count: int) -> tuple[Callable[..., bytes], bytes]:
    """How to pack so many goals, each one number of eight bytes, and the packet's beginning."""
    size = (GOAL_SIZE + 1) * count
    head = wire.HEADER + bytes((wire.BROADCAST_ID, size + 4, wire.SYNC_WRITE, GOAL_ADDRESS, GOAL_SIZE))
    return Struct(f"<{count}Q").pack, head


_GOALS: Final = tuple(map(_goals_layout, range(_MOST_GOALS + 1)))


def goals_size(count: int) -> int:
    """Bytes of a packet with so many goals."""
    return (GOAL_SIZE + 1) * count + _GOALS_OVERHEAD


def goals_packet(goals: Mapping[int, ServoGoal]) -> bytes:
    """One sync write with a goal for each servo. Raises ValueError where one does not fit.

    Acceleration 0, no ramp of the servo's own: the trajectory above is smooth already, and a ramp
    would stop the servo at every goal.
    """
    try:
        pack, head = _GOALS[len(goals)]
    except IndexError:
        raise ValueError(f"a packet holds {_MOST_GOALS} goals, not {len(goals)}: use another port") from None
    numbers: list[int] = []
    all_bits = 0
    for servo_id, goal in goals.items():
        position, velocity = goal.position_counts, goal.velocity_counts_s
        all_bits |= position | velocity
        numbers.append(servo_id | position << _POSITION_AT | velocity << _VELOCITY_AT)
    if all_bits & ~_MAGNITUDE:
        numbers = [_number(servo_id, goal) for servo_id, goal in goals.items()]
    packet = head + pack(*numbers)
    return packet + _CHECKSUMS[sum(packet) & 0xFF]


def _number(servo_id: int, goal: ServoGoal) -> int:
    """A goal that may have signs, or the complaint that it does not fit."""
    if goal.velocity_counts_s < 0:  # the register has a sign, which means nothing in position mode
        raise ValueError(f"a goal's velocity is 0 or more, not {goal.velocity_counts_s}: nothing written")
    position = _raw(sts.goal_position, goal.position_counts)
    velocity = _raw(sts.goal_velocity, goal.velocity_counts_s)
    return servo_id | position << _POSITION_AT | velocity << _VELOCITY_AT


def _raw(register: Register, value: int) -> int:
    return int.from_bytes(register.encode(value, _ORDER), _ORDER)
