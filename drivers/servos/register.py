"""Servos as data: a register is one line of a table, a servo model is a table."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal

ByteOrder = Literal["little", "big"]


class Access(Enum):
    """Who may change a register."""

    READ = "read"
    READ_WRITE = "read_write"


@dataclass(frozen=True, slots=True)
class Register:
    """One entry of a control table.

    ``sign_bit`` is the bit that holds the sign of a sign-magnitude number (Feetech's way of
    writing negative values); None means that there is none. ``signed`` registers hold two's
    complement (Dynamixel's way); with neither, the register is unsigned.
    ``persistent`` registers live in EEPROM: they survive power-off and wear out when written.
    """

    name: str
    address: int
    size: int
    access: Access = Access.READ_WRITE
    persistent: bool = False
    sign_bit: int | None = None
    signed: bool = False

    @property
    def largest(self) -> int:
        """The largest value that the register can say."""
        bits = self.size * 8 - self.signed if self.sign_bit is None else self.sign_bit
        return (1 << bits) - 1

    @property
    def smallest(self) -> int:
        """The smallest value that the register can say."""
        if self.signed:
            return -self.largest - 1
        return 0 if self.sign_bit is None else -self.largest

    def check(self, value: int) -> None:
        """Raise ValueError where the register cannot say ``value``."""
        if not self.smallest <= value <= self.largest:
            raise ValueError(f"{self.name} takes {self.smallest} to {self.largest}, not {value}: nothing written")

    def encode(self, value: int, order: ByteOrder) -> bytes:
        """``value`` as it goes over the wire. Raises ValueError where it does not fit."""
        self.check(value)
        raw = value
        if self.sign_bit is not None and value < 0:
            raw = -value | 1 << self.sign_bit
        return raw.to_bytes(self.size, order, signed=self.signed)

    def decode(self, data: bytes, order: ByteOrder) -> int:
        """The value in ``data``, which is ``size`` bytes long."""
        raw = int.from_bytes(data, order, signed=self.signed)
        return raw if self.sign_bit is None else signed(raw, 1 << self.sign_bit)


def signed(raw: int, sign: int) -> int:
    """A sign-magnitude number whose sign is the bit ``sign``."""
    return -(raw & sign - 1) if raw & sign else raw & sign - 1


def by_address(values: Iterable[object]) -> tuple[Register, ...]:
    """The registers among these values, by address: a control table."""
    return tuple(sorted((v for v in values if isinstance(v, Register)), key=lambda register: register.address))


def bit_names(bits: int, names: Mapping[int, str]) -> tuple[str, ...]:
    """The bits of one byte that are set, by name; one that the manuals do not name by its number."""
    return tuple(names.get(bit, f"unknown (bit {bit})") for bit in range(8) if bits >> bit & 1)


@dataclass(frozen=True, slots=True)
class ServoModel:
    """What distinguishes one servo model from another.

    ``stall_torque_nm`` and ``no_load_speed_rad_s`` are the datasheet's figures at ``rated_voltage_v``.
    """

    name: str
    number: int
    byte_order: ByteOrder
    counts_per_turn: int
    rated_voltage_v: float
    stall_torque_nm: float
    no_load_speed_rad_s: float
    positions: int | None = None
    """Readings and goals are below this where the sensor sees less than a turn; None: a whole turn."""

    @property
    def last_count(self) -> int:
        """The largest position that it can be told to go to, and know."""
        return (self.positions or self.counts_per_turn) - 1
