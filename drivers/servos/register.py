"""Registers and servo models."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal

ByteOrder = Literal["little", "big"]


class Access(Enum):
    """Access rights of a register."""

    READ = "read"
    READ_WRITE = "read_write"


@dataclass(frozen=True, slots=True)
class Register:
    """One register of a control table.

    Attributes:
        name: Name of the register.
        address: Address of its first byte.
        size: Size, in bytes.
        access: Whether the register can be written.
        persistent: Whether it is in EEPROM, which keeps its value without power and wears out when written.
        sign_bit: Sign bit of a sign-magnitude number (Feetech); None if there is none.
        signed: Whether it holds a two's complement number (Dynamixel).
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
        """Largest value of the register."""
        bits = self.size * 8 - self.signed if self.sign_bit is None else self.sign_bit
        return (1 << bits) - 1

    @property
    def smallest(self) -> int:
        """Smallest value of the register."""
        if self.signed:
            return -self.largest - 1
        return 0 if self.sign_bit is None else -self.largest

    def check(self, value: int) -> None:
        """Check that a value fits into the register.

        Args:
            value: Raw value.

        Raises:
            ValueError: The value is out of range.
        """
        if not self.smallest <= value <= self.largest:
            raise ValueError(f"{self.name} must be {self.smallest} to {self.largest}, not {value}: nothing was written")

    def encode(self, value: int, order: ByteOrder) -> bytes:
        """Convert a value to the bytes that are sent.

        Args:
            value: Raw value.
            order: Byte order of the servo.

        Returns:
            ``size`` bytes.

        Raises:
            ValueError: The value is out of range.
        """
        self.check(value)
        raw = value
        if self.sign_bit is not None and value < 0:
            raw = -value | 1 << self.sign_bit
        return raw.to_bytes(self.size, order, signed=self.signed)

    def decode(self, data: bytes, order: ByteOrder) -> int:
        """Convert received bytes to a value.

        Args:
            data: ``size`` bytes.
            order: Byte order of the servo.

        Returns:
            The raw value.
        """
        raw = int.from_bytes(data, order, signed=self.signed)
        return raw if self.sign_bit is None else signed(raw, 1 << self.sign_bit)


def signed(raw: int, sign: int) -> int:
    """Return the value of a sign-magnitude number. ``sign`` is the mask of its sign bit."""
    return -(raw & sign - 1) if raw & sign else raw & sign - 1


def by_address(values: Iterable[object]) -> tuple[Register, ...]:
    """Return the registers among these values, sorted by address."""
    return tuple(sorted((v for v in values if isinstance(v, Register)), key=lambda register: register.address))


def bit_names(bits: int, names: Mapping[int, str]) -> tuple[str, ...]:
    """Return the names of the bits that are set in a byte. A bit without a name is described by its number."""
    return tuple(names.get(bit, f"unknown (bit {bit})") for bit in range(8) if bits >> bit & 1)


@dataclass(frozen=True, slots=True)
class ServoModel:
    """Data of a servo model. Stall torque and no-load speed are datasheet values at the rated voltage.

    Attributes:
        name: Name in robot files.
        number: Model number that the servo reports.
        byte_order: Byte order of its registers.
        counts_per_turn: Position counts of a full turn.
        rated_voltage_v: Rated voltage, in V.
        stall_torque_nm: Stall torque, in N m.
        no_load_speed_rad_s: Speed without load, in rad/s.
        positions: Number of positions of a sensor that covers less than a turn; None for a full turn.
    """

    name: str
    number: int
    byte_order: ByteOrder
    counts_per_turn: int
    rated_voltage_v: float
    stall_torque_nm: float
    no_load_speed_rad_s: float
    positions: int | None = None

    @property
    def last_count(self) -> int:
        """Largest position that the servo can measure within one turn, in counts."""
        return (self.positions or self.counts_per_turn) - 1
