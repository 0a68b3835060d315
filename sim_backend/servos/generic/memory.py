"""The control table of one virtual servo that is no STS, as bytes: who may write what, what power-off forgets.

Addresses that the table does not list read 0 and cannot be written (assumed).

The lock (register 55), as the table puts it: 0 "save EEPROM changes", 1 "do not save". So a write
to EEPROM always takes effect at once; with the lock closed it is gone after power-off.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final

from drivers.servos import sts
from drivers.servos.register import Access, ByteOrder, Register, ServoModel
from sim_backend.flash import Flash, Kept

SIZE: Final = 256
EEPROM_END: Final = sts.torque_enable.address


def saturated(register: Register, value: int, order: ByteOrder) -> bytes:
    """``value`` as the register holds it, or the nearest that it can hold."""
    try:
        return register.encode(value, order)
    except ValueError:
        return register.encode(max(register.smallest, min(register.largest, value)), order)


class Memory:
    """The bytes that the wire sees, and the EEPROM's bytes behind them.

    Firmware and protection ask for the STS table's registers; a servo with another table answers in its
    own words (``own``, ``get``, ``put``).
    """

    EEPROM_END: ClassVar[int] = EEPROM_END
    RESET_ID: ClassVar[int | None] = None
    """The ID after a factory reset; None where the servo keeps its own."""
    BAUDS: ClassVar[int] = len(sts.BAUD_RATES)
    """As many values as ``baud_rate`` may have."""

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
        """Bits per second. Decoded with each write: every packet on the line is held against these two."""
        self.put(sts.servo_id, servo_id)
        self._save()
        self._restore(servo_id)
        self.power_up()

    def _decode_baud(self) -> int:
        """The bits per second that ``baud_rate`` stands for."""
        return sts.BAUD_RATES[self.get(sts.baud_rate)]

    def _decode(self) -> None:
        """Take ID and baud from the registers."""
        self.servo_id, self.baud = self.get(sts.servo_id), self._decode_baud()

    @property
    def answers(self) -> int:
        """What is answered: 0 pings, 1 reads too, 2 all."""
        return 2 if self.get(sts.status_level) else 1

    def own(self, register: Register) -> Register | None:
        """What this table calls a register of the STS table; None where it has nothing like it."""
        return register

    def get(self, register: Register) -> int:
        """A register's value, decoded."""
        end = register.address + register.size
        return register.decode(bytes(self._bytes[register.address : end]), self._order)

    def put(self, register: Register, value: int) -> None:
        """The firmware's own write: no access rules, volatile; values beyond the range saturate."""
        at = register.address
        self._bytes[at : at + register.size] = saturated(register, value, self._order)
        if at < self.EEPROM_END:
            self._decode()

    def read(self, address: int, size: int) -> bytes:
        """``size`` bytes from ``address``; zeros where the table ends."""
        return bytes(self._bytes[address : address + size]).ljust(size, b"\0")

    def write(self, address: int, data: bytes) -> None:
        """A write from the wire. Read-only bytes and senseless IDs and bauds stay as they are."""
        for at, value in enumerate(data, address):
            if at in self._writable and not self._senseless(at, value):
                self._write_byte(at, value)
        if address < self.EEPROM_END:
            self._decode()

    def _write_byte(self, at: int, value: int) -> None:
        self._bytes[at] = value
        if at < self.EEPROM_END and not self.get(sts.lock):
            self._saved[at] = value

    def power_up(self) -> None:
        """What the servo holds after power-on: the saved EEPROM, factory values in RAM."""
        self._bytes[self.EEPROM_END :] = bytes(SIZE - self.EEPROM_END)
        self._bytes[: self.EEPROM_END] = self._saved
        self._decode()
        for register, value in self._factory.items():
            if not register.persistent:
                self.put(register, value)
        self.put(sts.torque_limit, self.get(sts.max_torque))

    def restore_factory(self) -> None:
        """Instruction 0x06: EEPROM to factory values, saved; the ID too where ``RESET_ID`` says so."""
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
        """Put a persistent register so that it survives power-off, whatever the lock says."""
        self.put(register, value)
        own = self.own(register)
        if own is not None:
            span = slice(own.address, own.address + own.size)
            self._saved[span] = self._bytes[span]

    @property
    def flash(self) -> Flash:
        """What it keeps without power."""
        return Flash(bytes(self._saved))

    @flash.setter
    def flash(self, flash: Flash) -> None:
        self._saved[:] = flash.settings
        self.power_up()

    def _save(self) -> None:
        self._saved[:] = self._bytes[: self.EEPROM_END]

    def _senseless(self, address: int, value: int) -> bool:
        """Whether a servo would be lost to its bus with this value (that it refuses it is assumed)."""
        return value > 0xFD if address == self._id_at else address == self._baud_at and value >= self.BAUDS
