"""Descriptions of servo series and wire protocols."""

import math
from collections.abc import Callable, MutableMapping, Sequence
from dataclasses import dataclass, replace
from struct import Struct
from types import ModuleType
from typing import Any, Literal

from drivers.servos.register import ByteOrder, Register, ServoModel, signed
from drivers.types import ServoGoal, ServoState

Read = Callable[[Register], int]
"""Function that reads a register of the servo that is being checked."""


@dataclass(frozen=True, slots=True, eq=False)
class WireProtocol:
    """A wire protocol. Only servos with the same wire protocol can share a bus."""

    name: str
    packets: ModuleType
    """``drivers.protocol.v1`` or ``v2``."""
    byte_order: ByteOrder
    sdk: Callable[[], Any]
    """Function that creates the manufacturer's packet handler, for requests to a single servo."""
    group_read: Literal["sync", "bulk", "none"]
    """How one packet requests data from several servos: ``sync`` for all models, ``bulk`` only for models that support
    it."""
    reboot: Literal["acknowledged", "unanswered", "none"]
    waits_for_silent: bool = False
    """Whether a servo may fail to reply to a group read if the servo before it is silent."""
    refusals: int = 0
    """Bits of a reply's error byte that indicate a rejected instruction. The other bits are alarms and belong to the
    state."""
    refusal: Callable[[int], str] = "rejected the instruction (error {})".format
    """Function that describes the rejection bits, worded to follow the servo's name."""
    arrived_corrupt: Callable[[int], bool] = lambda refused: False
    """Function that returns whether the rejection bits report a corrupt instruction packet. The request can then be
    repeated.
    """
    factory_reset: bytes = b""
    """Option byte of the factory reset instruction."""
    broadcast_ping: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class StateBlock:
    """A block of ``size`` bytes at ``address`` that holds the whole state of a servo.

    ``fields`` is the layout of the numbers in the state, which start at offset ``at``. ``state`` converts the model's
    scale (``Series.scale_of``), the error byte of the reply and these numbers to a state. ``proof`` holds the expected
    first and last numbers of an intact block. If the actual numbers differ, the data have no meaning.
    """

    address: int
    size: int
    fields: Struct
    at: int
    state: Callable[..., ServoState]
    fast: bool = False
    """Whether some firmware versions support fast sync reads of this block."""
    proof: tuple[int, int] | None = None

    def proved(self, numbers: Sequence[int]) -> bool:
        """Return whether the first and the last number prove that the block is intact."""
        return self.proof is None or (numbers[0], numbers[-1]) == self.proof

    def decode(self, scale: float | None, error: int, data: bytes) -> ServoState | None:
        """Return the state contained in a reply's data, or None if the proof is missing."""
        numbers = self.fields.unpack_from(data, self.at)
        return self.state(scale, error, *numbers) if self.proved(numbers) else None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Series:
    """Servos with the same control table.

    ``blocks`` holds state blocks of different sizes, with the preferred block first. If a late reply to a request is
    possible, a block of a different size is read next (drivers/bus/late_replies.py). ``config_error`` reads the
    settings and returns the reason why the servo must not be used with them, or None.
    """

    name: str
    make: Literal["feetech", "dynamixel"]
    protocol: WireProtocol
    by_name: MutableMapping[str, Any]
    """Models of the series, keyed by name. ``catalog.add`` adds models defined by a user."""
    registers: tuple[Register, ...]
    """Registers of all models, sorted by address."""
    goal_block: tuple[Register, ...]
    blocks: tuple[StateBlock, ...]
    goal_fields: str
    """Layout of the goal block in the notation of ``struct``."""
    goal_of: Callable[[ServoModel], Callable[[ServoGoal], tuple[int, ...]]]
    """Function that returns an encoder for goals of a model. The encoder raises ValueError if a goal does not fit."""
    scale_of: Callable[[ServoModel], float | None] = lambda model: None
    """Function that returns a model's unit of speed or current, for series whose models use different units."""
    servo_id: Register
    model_number: Register
    status_level: Register
    answers_all: int
    """Value of ``status_level`` at which writes are acknowledged."""
    torque_enable: Register
    goal_position: Register
    position_limits: tuple[Register, Register]
    """Registers of the lowest and the highest goal."""
    max_torque: Register
    """Persistent torque limit, which ``torque_limit`` must not exceed."""
    torque_limit: Register | None
    """Torque limit in RAM. None if the control table has none."""
    full_torque: int
    """Full torque, in the unit of both limits."""
    config_error: Callable[[ServoModel, Read], str | None]
    config_warning: Callable[[Read], str | None] = lambda read: None
    """Function that returns a warning about unusual settings that do not prevent use of the servo, or None."""
    harmless: Register | None = None
    """RAM register that can be rewritten with its own value to test whether writes are acknowledged."""
    before_torque: tuple[tuple[Register, int], ...] = ()
    """Registers to write before torque is enabled, with their values."""
    torque_by_goal: bool = True
    """Whether a goal may enable torque. In this case, only the torque limit shows whether the servo was reset."""
    position_p: Register | None = None
    """Position P gain register, if the gain is in RAM."""
    hardware_error: tuple[Register, Callable[[int], tuple[str, ...]]] | None = None
    """Register that identifies the alarms, and its decoder, if replies report only that there are alarms."""
    bulk_read: Callable[[ServoModel], bool] = lambda model: False
    """Function that returns whether a model supports bulk reads, for protocols in which only some models do."""
    lock: Register | None = None
    """EEPROM lock: 1 locks, 0 unlocks. None for Dynamixel servos, whose EEPROM is unlocked while torque is disabled."""

    @property
    def models(self) -> tuple[ServoModel, ...]:
        """Models of this series. Models added by the user come last."""
        return tuple(self.by_name.values())

    @property
    def torque_state(self) -> Register:
        """Register for reading the torque switch and, if a goal may enable torque, the torque limit in one read."""
        last = (self.torque_by_goal and self.torque_limit) or self.torque_enable
        return replace(self.torque_enable, size=last.address + last.size - self.torque_enable.address)

    def drives(self, state: int, limit: int | None) -> bool:
        """Return whether a servo has its torque enabled and uses this torque limit.

        Args:
            state: Value of ``torque_state``.
            limit: Expected value of the torque limit. If None, any limit is accepted.
        """
        behind = self.torque_state.size - 2  # offset of the two limit bytes, which come last
        return state & 0xFF == 1 and (behind < 0 or limit is None or state >> 8 * behind == limit)

    @property
    def goal_address(self) -> int:
        return self.goal_block[0].address

    @property
    def goal_size(self) -> int:
        return sum(register.size for register in self.goal_block)


def blocks_from_start(
    registers: tuple[Register, ...], sizes: tuple[int, ...], fields: Struct, state: Callable[..., ServoState]
) -> tuple[StateBlock, ...]:
    """Return blocks with these sizes. Each block begins with the state in ``registers``."""
    return tuple(StateBlock(registers[0].address, size, fields, 0, state) for size in sizes)


def blocks_to_end(
    starts: tuple[Register, ...], end: int, fields: Struct, state: Callable[..., ServoState], *, fast: bool
) -> tuple[StateBlock, ...]:
    """Return one block that starts at each of these registers. All blocks end at ``end``, with the state at the end."""
    sizes = {first.address: end - first.address for first in starts}
    return tuple(StateBlock(at, size, fields, size - fields.size, state, fast) for at, size in sizes.items())


def bit_10_state(unit_counts_s: float, alarms: tuple[str, ...], numbers: tuple[int, ...]) -> ServoState:
    """Convert register values to a state, for servos that store the direction of speed and load in bit 10.

    Args:
        unit_counts_s: Unit of the speed, in counts/s.
        alarms: Names of the alarms.
        numbers: Position, speed, load, voltage and temperature.

    Returns:
        The state, in the units of ``ServoState``.
    """
    position, speed, load, voltage, temperature = numbers
    velocity_counts_s = round(signed(speed, 1 << 10) * unit_counts_s)
    return ServoState(
        position, velocity_counts_s, signed(load, 1 << 10) / 1023, voltage * 0.1, float(temperature), alarms
    )


def bit_10_goal_of(last: int, unit_counts_s: float) -> Callable[[ServoGoal], tuple[int, ...]]:
    """Return the function that encodes goals for these servos, whose maximum speed is 1023."""

    def goal(wanted: ServoGoal) -> tuple[int, ...]:
        check_goal(last, wanted)
        # The speed is rounded up, so that the servo is not slower than requested and only 0 stays 0 (maximum speed).
        return wanted.position_counts, min(math.ceil(wanted.velocity_counts_s / unit_counts_s), 1023)

    return goal


def check_goal(last: int, goal: ServoGoal) -> None:
    """Raise ValueError if the position is not between 0 and ``last`` or the velocity is negative."""
    # The check is done before the conversion, which may turn a small negative velocity into 0 (maximum velocity).
    if not 0 <= goal.position_counts <= last:
        raise ValueError(f"goal_position must be 0 to {last}, not {goal.position_counts}: nothing was written")
    if goal.velocity_counts_s < 0:
        raise ValueError(f"goal velocity must be 0 or more, not {goal.velocity_counts_s}: nothing was written")
