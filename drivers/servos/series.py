"""A series is what the bus must know of servos with one control table; a wire protocol is how a line of them speaks."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from struct import Struct
from types import ModuleType
from typing import Any, Literal

from drivers.bus.types import ServoGoal, ServoState
from drivers.servos.register import ByteOrder, Register, ServoModel, signed

Read = Callable[[Register], int]
"""Reads a register of the servo that is looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class WireProtocol:
    """Servos of one wire protocol can share a line."""

    name: str
    packets: ModuleType
    """``drivers.protocol.v1`` or ``v2``."""
    byte_order: ByteOrder
    sdk: Callable[[], Any]
    """The maker's packet handler, for calls to one servo."""
    group_read: Literal["sync", "bulk", "none"]
    """How several servos are asked by one packet. ``sync``: all of them; ``bulk``: only models that know it."""
    reboot: Literal["acknowledged", "unanswered", "none"]
    waits_for_silent: bool = False
    """Whether a servo may wait in vain for one before it in a group read that is silent."""
    refusals: int = 0
    """Those bits of a reply's error byte that refuse an instruction. The others are alarms, which are states."""
    refusal: Callable[[int], str] = "refused the instruction (error {})".format
    """What they say, behind "it" or the servo's name."""
    came_broken: Callable[[int], bool] = lambda refused: False
    """Whether they say that the instruction came broken: that is the line's fault, and it may be given again."""
    factory_reset: bytes = b""
    """The option of the instruction."""
    broadcast_ping: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class StateBlock:
    """A state block is ``size`` bytes from ``address`` that hold the whole state of a servo.

    ``fields`` are the state's numbers, ``at`` so many bytes from the block's beginning. ``state`` makes values of the
    model's own scale (see ``Series.scale_of``), of the reply's error byte and of these numbers.
    ``proof``: the first and the last number as long as the block is what it is taken for; otherwise the numbers
    mean nothing.
    """

    address: int
    size: int
    fields: Struct
    at: int
    state: Callable[..., ServoState]
    fast: bool = False
    """Whether some firmware answers a fast sync read of it."""
    proof: tuple[int, int] | None = None

    def proved(self, numbers: Sequence[int]) -> bool:
        """Whether the numbers are what they are taken for."""
        return self.proof is None or (numbers[0], numbers[-1]) == self.proof

    def decode(self, scale: float | None, error: int, data: bytes) -> ServoState | None:
        """The state in one reply's data; None without proof."""
        numbers = self.fields.unpack_from(data, self.at)
        return self.state(scale, error, *numbers) if self.proved(numbers) else None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Series:
    """Servos with one control table.

    ``blocks``: what may be asked for, all of one state but of different sizes, the preferred first: a servo that may
    still answer an earlier question is asked for another (drivers/bus/late_replies.py). ``config_error`` reads the
    settings: why the servo must not be driven like this, if so.
    """

    name: str
    make: Literal["feetech", "dynamixel"]
    protocol: WireProtocol
    models: tuple[ServoModel, ...]
    registers: tuple[Register, ...]
    """What all models have, by address."""
    goal_block: tuple[Register, ...]
    blocks: tuple[StateBlock, ...]
    goal_fields: str
    """The numbers of the goal block, as ``struct`` calls them."""
    goal_of: Callable[[ServoModel], Callable[[ServoGoal], tuple[int, ...]]]
    """Of a model: makes these numbers of a goal. ValueError for a goal that does not fit."""
    scale_of: Callable[[ServoModel], float | None] = lambda model: None
    """What the model needs beside the table to make values of its numbers."""
    servo_id: Register
    model_number: Register
    status_level: Register
    answers_all: int
    """Value of ``status_level`` at which writes are acknowledged."""
    torque_enable: Register
    goal_position: Register
    position_limits: tuple[Register, Register]
    """The lowest and the highest goal."""
    max_torque: Register
    """What lasts over power-off, and ``torque_limit`` must not exceed."""
    torque_limit: Register | None
    """None where the table has no limit that ends with the power."""
    full_torque: int
    """Full drive, in the units of both."""
    config_error: Callable[[ServoModel, Read], str | None]
    config_warning: Callable[[Read], str | None] = lambda read: None
    """What is odd about the settings, and no reason to refuse the servo."""
    harmless: Register | None = None
    """A register of RAM that may be written with what it holds, to see whether writes are acknowledged."""
    before_torque: tuple[tuple[Register, int], ...] = ()
    """What to write before the torque goes on."""
    torque_by_goal: bool = True
    """Whether a goal may switch the torque on, also of a servo that was reset: only its limit tells that one."""
    position_p: Register | None = None
    """The position P gain, where it lives in RAM."""
    hardware_error: tuple[Register, Callable[[int], tuple[str, ...]]] | None = None
    """Where the names of alarms stand, where a reply only says that there are any."""
    bulk_models: tuple[ServoModel, ...] = ()
    """Those that answer a bulk read, where not all do."""
    lock: Register | None = None
    """What guards the EEPROM: 1 closes it, 0 opens it. Dynamixel has none: torque off is its key."""

    @property
    def torque_state(self) -> Register:
        """The torque switch and, where a goal may move it, all up to the torque limit: one question."""
        last = (self.torque_by_goal and self.torque_limit) or self.torque_enable
        return replace(self.torque_enable, size=last.address + last.size - self.torque_enable.address)

    def drives(self, state: int, limit: int | None) -> bool:
        """Whether a servo with this torque state drives its motor, with this limit (None: any)."""
        behind = self.torque_state.size - 2  # the limit's two bytes, the highest ones
        return state & 0xFF == 1 and (behind < 0 or limit is None or state >> 8 * behind == limit)

    @property
    def goal_address(self) -> int:
        """Where the goal block begins."""
        return self.goal_block[0].address

    @property
    def goal_size(self) -> int:
        """Bytes of the goal block."""
        return sum(register.size for register in self.goal_block)


def blocks_from_start(
    registers: tuple[Register, ...], sizes: tuple[int, ...], fields: Struct, state: Callable[..., ServoState]
) -> tuple[StateBlock, ...]:
    """Blocks of these sizes that all begin with the state, which ``registers`` are."""
    return tuple(StateBlock(registers[0].address, size, fields, 0, state) for size in sizes)


def blocks_to_end(
    starts: tuple[Register, ...], end: int, fields: Struct, state: Callable[..., ServoState], *, fast: bool
) -> tuple[StateBlock, ...]:
    """Blocks that begin with these registers, all with one end, where the state is."""
    sizes = {first.address: end - first.address for first in starts}
    return tuple(StateBlock(at, size, fields, size - fields.size, state, fast) for at, size in sizes.items())


def bit_10_state(
    unit_counts_s: float, alarms: tuple[str, ...], position: int, speed: int, load: int, voltage: int, temperature: int
) -> ServoState:
    """The state of the Dynamixels whose speeds and loads have their direction in bit 10; 1023 is full drive."""
    velocity_counts_s = round(signed(speed, 1 << 10) * unit_counts_s)
    return ServoState(
        position, velocity_counts_s, signed(load, 1 << 10) / 1023, voltage * 0.1, float(temperature), alarms
    )


def bit_10_goal_of(last: int, unit_counts_s: float) -> Callable[[ServoGoal], tuple[int, ...]]:
    """Position and speed of theirs, of which 1023 is the largest."""

    def goal(wanted: ServoGoal) -> tuple[int, ...]:
        check_goal(last, wanted)
        # Rounded up: the servo is never slower than asked, and 0 alone stays 0, as fast as it can.
        return wanted.position_counts, min(math.ceil(wanted.velocity_counts_s / unit_counts_s), 1023)

    return goal


def check_goal(last: int, goal: ServoGoal) -> None:
    """ValueError where a servo with positions 0 to ``last`` has no such position, or nobody such a velocity."""
    # Before it is in the servo's units: there a small negative one may be 0, which is as fast as the servo can.
    if not 0 <= goal.position_counts <= last:
        raise ValueError(f"goal_position takes 0 to {last}, not {goal.position_counts}: nothing written")
    if goal.velocity_counts_s < 0:
        raise ValueError(f"a goal's velocity is 0 or more, not {goal.velocity_counts_s}: nothing written")
