"""Control table of one virtual servo other than STS, as bytes: access rules, and the registers that survive power-off.

Addresses that the table does not list read as 0 and cannot be written (assumed).

The lock (register 55) has two values in Feetech's table: 0 "save EEPROM changes" and 1 "do not save". A write to the
EEPROM always takes effect immediately, but the value is lost at power-off if the lock is set.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final

from drivers.servos import sts
from drivers.servos.register import Access, ByteOrder, Register, ServoModel
from sim_backend.flash import Flash, Kept

SIZE: Final = 256
EEPROM_END: Final = sts.torque_enable.address


def saturated(register: Register, value: int, order: ByteOrder) -> bytes:
    """Encode ``value`` for the register. A value outside the range is replaced by the nearest allowed value."""
    try:
        return register.encode(value, order)
    except ValueError:
        return register.encode(max(register.smallest, min(register.largest, value)), order)


def touches(address: int, size: int, register: Register) -> bool:
    """Return whether a write of ``size`` bytes from ``address`` includes a byte of ``register``."""
    return address < register.address + register.size and register.address < address + size


class Memory:
    """Control table bytes, as a client reads them, and the saved EEPROM bytes.

    The firmware and the protection use the register names of the STS table. For a servo with a different table,
    ``own``, ``get`` and ``put`` convert register names and values.
    """

    EEPROM_END: ClassVar[int] = EEPROM_END
    RESET_ID: ClassVar[int | None] = None
    """ID after a factory reset; None if the servo keeps its ID."""
    BAUDS: ClassVar[int] = len(sts.BAUD_RATES)
    """Number of valid values of ``baud_rate``."""

    def __init__(
        self,
        model: ServoModel,
        servo_id: int,
        registers: Sequence[Register],
        factory: Mapping[Register, int],
    ) -> None:
        self._factory = factory
        self._writable = frozenset(
            register.address + i
            for register in registers
            if register.access is Access.READ_WRITE
            for i in range(register.size)
        )
        self._id_at, self._baud_at = (
            next(register.address for register in registers if register.name == name)
            for name in (sts.servo_id.name, sts.baud_rate.name)
        )
        self._order = model.byte_order
        self.kept = Kept(registers, (at for at in self._writable if at < self.EEPROM_END), model.byte_order)
        self._model = model
        self._bytes = bytearray(SIZE)
        self._saved = bytearray(self.EEPROM_END)
        self.servo_id = servo_id
        self.baud = 0
        """Baud rate in bits per second. The baud rate is decoded at each write, as is the ID, because every packet
        needs both."""
        self.put(sts.servo_id, servo_id)
        self._save()
        self._restore(servo_id)
        self.power_up()

    def _decode_baud(self) -> int:
        """Return the baud rate for a value of ``baud_rate``, in bits per second."""
        return sts.BAUD_RATES[self.get(sts.baud_rate)]

    def _decode(self) -> None:
        """Decode the ID and the baud rate."""
        self.servo_id, self.baud = self.get(sts.servo_id), self._decode_baud()

    @property
    def answers(self) -> int:
        """Status level. At level 0, the servo replies only to pings. At level 1, it also replies to reads. At level 2,
        it replies to every instruction."""
        return 2 if self.get(sts.status_level) else 1

    def own(self, register: Register) -> Register | None:
        """Return this table's register that corresponds to an STS register, or None if there is none."""
        return register

    def get(self, register: Register) -> int:
        """Return the decoded value of a register."""
        end = register.address + register.size
        return register.decode(bytes(self._bytes[register.address : end]), self._order)

    def put(self, register: Register, value: int) -> None:
        """Write to a register without applying access rules; the value is lost at power-off. Values outside the range
        of the register are clipped."""
        at = register.address
        self._bytes[at : at + register.size] = saturated(register, value, self._order)
        if at < self.EEPROM_END:
            self._decode()

    def read(self, address: int, size: int) -> bytes:
        """Return ``size`` bytes starting at ``address``, with zeros beyond the end of the table."""
        return bytes(self._bytes[address : address + size]).ljust(size, b"\0")

    def write(self, address: int, data: bytes) -> None:
        """Write bytes that came over the wire. Writes of read-only bytes, invalid IDs or invalid baud rates are
        ignored."""
        for at, value in enumerate(data, address):
            if at in self._writable and not self._invalid(at, value):
                self._write_byte(at, value)
        if address < self.EEPROM_END:
            self._decode()

    def _write_byte(self, at: int, value: int) -> None:
        self._bytes[at] = value
        if at < self.EEPROM_END and not self.get(sts.lock):
            self._saved[at] = value

    def power_up(self) -> None:
        """Set the power-on values: the saved EEPROM values, and factory values in RAM."""
        self._bytes[self.EEPROM_END :] = bytes(SIZE - self.EEPROM_END)
        self._bytes[: self.EEPROM_END] = self._saved
        self._decode()
        for register, value in self._factory.items():
            if not register.persistent:
                self.put(register, value)
        self.put(sts.torque_limit, self.get(sts.max_torque))

    def restore_factory(self) -> None:
        """Reset the EEPROM to factory values and save them (instruction 0x06). ``RESET_ID`` determines the ID after the
        reset."""
        self._restore(self.get(sts.servo_id) if self.RESET_ID is None else self.RESET_ID)

    def _restore(self, servo_id: int) -> None:
        self._bytes[: self.EEPROM_END] = bytes(self.EEPROM_END)
        for register, value in self._factory.items():
            if register.persistent:
                self.put(register, value)
        self.put(sts.model_number, self._model.number)
        self.put(sts.servo_id, servo_id)
        self._save()

    def save(self, register: Register, value: int) -> None:
        """Write a persistent register so that the value survives power-off, regardless of the lock."""
        self.put(register, value)
        own = self.own(register)
        if own is not None:
            span = slice(own.address, own.address + own.size)
            self._saved[span] = self._bytes[span]

    @property
    def flash(self) -> Flash:
        """Contents of the flash memory."""
        return Flash(bytes(self._saved))

    @flash.setter
    def flash(self, flash: Flash) -> None:
        self._saved[:] = flash.settings
        self.power_up()

    def _save(self) -> None:
        self._saved[:] = self._bytes[: self.EEPROM_END]

    def _invalid(self, address: int, value: int) -> bool:
        """Return whether this value would make the servo unreachable on the bus. Such a write is rejected (assumed)."""
        return value > 0xFD if address == self._id_at else address == self._baud_at and value >= self.BAUDS
