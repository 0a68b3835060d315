"""Registers and servo models."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, NamedTuple

ByteOrder = Literal["little", "big"]


class Access(Enum):
    """Access rights of a register."""

    READ = "read"
    READ_WRITE = "read_write"


def between(lowest: int, highest: int) -> tuple[range, ...]:
    """Return the register values from ``lowest`` to ``highest``, inclusive."""
    return (range(lowest, highest + 1),)


def one_of(*values: int) -> tuple[range, ...]:
    """Return the values of a register that accepts only the listed values."""
    return tuple(range(value, value + 1) for value in values)


@dataclass(frozen=True, slots=True)
class Register:
    """One register of a control table.

    Two registers are equal if they are read and written in the same way, even if they accept different values.

    Attributes:
        name: Name of the register.
        address: Address of its first byte.
        size: Size, in bytes.
        access: Whether the register can be written.
        persistent: Whether the register is in EEPROM, which keeps its value without power and wears out when written.
        sign_bit: Sign bit of a sign-magnitude number (Feetech); None if the register has none.
        signed: Whether the register holds a two's complement number (Dynamixel).
        values: Values that the servo accepts, in ascending order. The tuple is empty if every value that fits is
            accepted.
    """

    name: str
    address: int
    size: int
    access: Access = Access.READ_WRITE
    persistent: bool = False
    sign_bit: int | None = None
    signed: bool = False
    values: tuple[range, ...] = field(default=(), compare=False)

    @property
    def fitting(self) -> range:
        """All values that fit into the register's bytes, including values that the servo rejects."""
        bits = self.size * 8 - self.signed if self.sign_bit is None else self.sign_bit
        largest = (1 << bits) - 1
        if self.signed:
            return range(-largest - 1, largest + 1)
        return range(0 if self.sign_bit is None else -largest, largest + 1)

    @property
    def largest(self) -> int:
        """Largest value that the servo accepts."""
        return (self.values[-1] if self.values else self.fitting).stop - 1

    @property
    def smallest(self) -> int:
        """Smallest value that the servo accepts."""
        return (self.values[0] if self.values else self.fitting).start

    @property
    def values_text(self) -> str:
        """The accepted values as a string for messages, such as "1, 3 to 4 or 16"."""
        spans = [
            f"{span.start}" if len(span) == 1 else f"{span.start} to {span.stop - 1}"
            for span in self.values or (self.fitting,)
        ]
        return " or ".join(filter(None, (", ".join(spans[:-1]), spans[-1])))

    def takes(self, value: int) -> bool:
        """Return whether the servo accepts a value.

        Args:
            value: Raw value.

        Returns:
            True if the value is one of ``values`` and fits.
        """
        return any(value in span for span in self.values) if self.values else value in self.fitting

    def check(self, value: int) -> None:
        """Check that the servo accepts a value.

        Args:
            value: Raw value.

        Raises:
            ValueError: The servo would refuse the value.
        """
        if not self.takes(value):
            raise ValueError(f"{self.name} must be {self.values_text}, not {value}: nothing was written")

    def encode(self, value: int, order: ByteOrder) -> bytes:
        """Convert a value to the bytes that are sent. Call ``check`` to determine whether the servo accepts the value.

        Args:
            value: Raw value.
            order: Byte order of the servo.

        Returns:
            ``size`` bytes.

        Raises:
            ValueError: The value does not fit into the register.
        """
        if value not in self.fitting:
            raise ValueError(f"{self.name} must be {self.values_text}, not {value}: nothing was written")
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
    """Return the value of a sign-magnitude number. ``sign`` is the mask for its sign bit."""
    return -(raw & sign - 1) if raw & sign else raw & sign - 1


def by_address(values: Iterable[object]) -> tuple[Register, ...]:
    """Return the registers found among these values, sorted by address."""
    return tuple(sorted((v for v in values if isinstance(v, Register)), key=lambda register: register.address))


def merged(common: Iterable[Register], own: Iterable[Register]) -> tuple[Register, ...]:
    """Return a table of common registers, in which the registers in ``own`` replace those with the same name."""
    return by_address({register.name: register for register in (*common, *own)}.values())


def bit_names(bits: int, names: Mapping[int, str]) -> tuple[str, ...]:
    """Return the names of the bits that are set in a byte. A bit without a name is described by its number."""
    return tuple(names.get(bit, f"unknown (bit {bit})") for bit in range(8) if bits >> bit & 1)


class Datasheet(NamedTuple):
    """Datasheet values of a motor, all specified at the rated voltage."""

    rated_voltage_v: float
    stall_torque_nm: float
    stall_current_a: float
    no_load_rpm: float

    @property
    def no_load_speed_rad_s(self) -> float:
        """No-load speed, in rad/s."""
        return self.no_load_rpm * 2.0 * math.pi / 60.0


@dataclass(frozen=True, slots=True)
class ServoModel:
    """Data about a servo model. Stall torque and no-load speed are datasheet values at the rated voltage.

    Attributes:
        name: Name in robot files.
        number: Model number that the servo reports.
        byte_order: Byte order of its registers.
        counts_per_turn: Number of position counts per full turn.
        rated_voltage_v: Rated voltage, in V.
        stall_torque_nm: Stall torque, in N m.
        no_load_speed_rad_s: No-load speed, in rad/s.
        positions: Number of positions of a sensor that covers less than a turn; None for a full turn.
        own: Registers that not all models of the series have, or that accept different values in this model.
        supply_v: Lowest and highest rated voltage, in V; None to use the usual fractions of the rated voltage.
    """

    name: str
    number: int
    byte_order: ByteOrder
    counts_per_turn: int
    rated_voltage_v: float
    stall_torque_nm: float
    no_load_speed_rad_s: float
    positions: int | None = None
    own: tuple[Register, ...] = ()
    supply_v: tuple[float, float] | None = None

    @property
    def last_count(self) -> int:
        """Largest position that the servo can measure within one turn, in counts."""
        return (self.positions or self.counts_per_turn) - 1
