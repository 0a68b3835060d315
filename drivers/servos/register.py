"""Define registers and servo models. Both are data: a servo model is a table of registers."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal

ByteOrder = Literal["little", "big"]


class Access(Enum):
    """Access to a register."""

    READ = "read"
    READ_WRITE = "read_write"


@dataclass(frozen=True, slots=True)
class Register:
    """Register of a control table."""

    name: str
    """Name in the control table, such as ``present_position``."""
    address: int
    """Address of the first byte."""
    size: int
    """Size in bytes."""
    access: Access = Access.READ_WRITE
    """Whether the register can be written."""
    persistent: bool = False
    """Whether the register is in EEPROM. It then survives a power-off, and wears out when it is written."""
    sign_bit: int | None = None
    """Bit with the sign of a sign-magnitude number, as Feetech writes negative values; None if there is no sign bit."""
    signed: bool = False
    """Whether the value is in two's complement, as Dynamixel writes negative values. Otherwise, without
    ``sign_bit``, it is unsigned."""

    @property
    def largest(self) -> int:
        """Largest value that the register can hold."""
        bits = self.size * 8 - self.signed if self.sign_bit is None else self.sign_bit
        return (1 << bits) - 1

    @property
    def smallest(self) -> int:
        """Smallest value that the register can hold."""
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
            raise ValueError(f"{self.name} takes {self.smallest} to {self.largest}, not {value}: nothing written")

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
    """Properties of a servo model."""

    name: str
    """Name in robot files, such as ``sts3215``."""
    number: int
    """Model number that the servo reports."""
    byte_order: ByteOrder
    """Byte order of words."""
    counts_per_turn: int
    """Counts in a full turn of the shaft."""
    rated_voltage_v: float
    """Rated voltage, in V."""
    stall_torque_nm: float
    """Stall torque at the rated voltage, from the data sheet, in N m."""
    no_load_speed_rad_s: float
    """Speed without load at the rated voltage, from the data sheet, in rad/s."""
    positions: int | None = None
    """Number of positions, if the sensor covers less than a turn; None for a whole turn."""

    @property
    def last_count(self) -> int:
        """Largest position, in counts, that the servo can reach and report."""
        return (self.positions or self.counts_per_turn) - 1
