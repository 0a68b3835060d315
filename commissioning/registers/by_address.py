"""Read and write a servo's memory by address, for registers that are not named in servoloop's control tables."""

from dataclasses import dataclass
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.access import write_ram
from commissioning.scan.find import FoundServo
from drivers.printable import counted
from drivers.protocol import v1
from drivers.servos.catalog import registers_of
from drivers.servos.register import Register

SIZES: Final = (1, 2, 4)
"""Possible register sizes, in bytes."""
_END: Final = {True: 1 << 8, False: 1 << 16}
"""End of the address range of protocol 1.0 (True) and protocol 2.0 (False)."""


@dataclass(frozen=True, slots=True)
class AddressValue:
    """Value of a register that is identified only by its address."""

    servo_id: int
    address: int
    size: int
    raw: int


@dataclass(frozen=True, slots=True)
class AddressWrite:
    """Result of a write to an address. ``before`` and ``after`` are equal if the servo already had the value."""

    servo_id: int
    address: int
    size: int
    before: int
    after: int


def read_address(servo: FoundServo, address: int, size: int) -> AddressValue:
    """Read the unsigned number at an address of the servo's memory.

    Args:
        servo: The servo. The servo's model may be unknown.
        address: Address of the first byte.
        size: Size, in bytes: 1, 2 or 4.

    Returns:
        The value.

    Raises:
        CommissioningError: The address or the size is out of range.
        ServoError: The servo does not respond, or it rejects the read.
    """
    return AddressValue(servo.servo_id, address, size, servo.read(_register(servo, address, size)))


def write_address(servo: FoundServo, address: int, size: int, value: int) -> AddressWrite:
    """Write an unsigned number to an address of the servo's memory and read it back.

    The caller must know the register: neither its purpose nor the servo's torque state is checked. An address in the
        control table of a known model is rejected, because ``write_register`` has checks for it.

    Args:
        servo: The servo. Its model may be unknown.
        address: Address of the first byte.
        size: Size, in bytes: 1, 2 or 4.
        value: Value to write.

    Returns:
        The value before the write and the value after it.

    Raises:
        CommissioningError: The address, size or value is rejected, or the servo does not keep the value.
        ServoError: The servo does not respond, or it rejects the write.
    """
    register = _register(servo, address, size)
    _refuse_named(servo, register)
    try:
        register.check(value)
    except ValueError as error:
        raise CommissioningError(f"servo {servo.servo_id}: {error}") from error
    before = servo.read(register)
    if value != before:
        write_ram(servo, register, value)
    return AddressWrite(servo.servo_id, address, size, before, value)


def _register(servo: FoundServo, address: int, size: int) -> Register:
    if size not in SIZES:
        raise CommissioningError(f"servo {servo.servo_id}: a register has 1, 2 or 4 bytes, not {size}")
    last = _END[servo.packets is v1] - size
    if not 0 <= address <= last:
        raise CommissioningError(
            f"servo {servo.servo_id}: the address of a register of {counted(size, 'byte')} must be 0 to {last}, "
            f"not {address}"
        )
    return Register(f"address {address}", address, size)


def _refuse_named(servo: FoundServo, register: Register) -> None:
    if servo.identity.model is None:
        return
    end = register.address + register.size
    for named in registers_of(servo.model):
        if named.address < end and register.address < named.address + named.size:
            raise CommissioningError(
                f"servo {servo.servo_id}: {register.name} is part of {named.name}: write it by name"
            )
