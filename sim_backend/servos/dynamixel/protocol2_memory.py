"""Control table of a virtual protocol 2.0 servo as bytes: access rules, and the registers that survive power-off.

Assumed: a write that breaks a rule is rejected entirely, and addresses that the table does not list read as 0.
"""

from abc import ABC
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

from drivers.servos.register import Access, Register, ServoModel
from sim_backend.flash import Flash, Kept
from sim_backend.servos.generic.memory import saturated

DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = 4, 5, 6, 7
"""Error numbers of a reply."""


class Protocol2Memory(ABC):
    """Control table bytes, as a client reads them.

    Every write to EEPROM bytes is saved, and the bytes are locked while the torque is enabled.
    """

    SIZE: ClassVar[int]
    EEPROM_END: ClassVar[int]
    BAUD_RATES: ClassVar[Sequence[int]]
    """Baud rates, indexed by the value of ``baud_rate``."""

    def __init__(
        self, model: ServoModel, servo_id: int, registers: Sequence[Register], factory: Mapping[Register, int]
    ) -> None:
        self._model = model
        self._registers = {register.address: register for register in registers}
        named = {register.name: register for register in registers}
        self._id, self._baud, self._number, self._torque = (
            named[name] for name in ("id", "baud_rate", "model_number", "torque_enable")
        )
        self.kept = Kept((r for r in registers if r.persistent), range(self.EEPROM_END), "little")
        self._factory = factory
        self._bytes = bytearray(self.SIZE)
        self.servo_id = servo_id
        self.baud = 0
        """Baud rate in bits per second. The baud rate and the ID are decoded at each write, because every packet needs
        both."""
        self.restore_factory()
        self.put(self._id, servo_id)
        self.power_up()

    def get(self, register: Register) -> int:
        """Return the decoded value of a register."""
        end = register.address + register.size
        return register.decode(bytes(self._bytes[register.address : end]), "little")

    def put(self, register: Register, value: int) -> None:
        """Write to a register without applying access rules. Values outside the register's range are clipped."""
        at = register.address
        self._bytes[at : at + register.size] = saturated(register, value, "little")
        if at < self.EEPROM_END:
            self._decode()

    def save(self, register: Register, value: int) -> None:
        """Write a persistent register. On these servos, every write to the EEPROM is saved."""
        self.put(register, value)

    def _decode(self) -> None:
        """Decode the ID and the baud rate."""
        self.servo_id, self.baud = self.get(self._id), self.BAUD_RATES[self.get(self._baud)]

    def read(self, address: int, size: int) -> bytes:
        """Return ``size`` bytes starting at ``address``, as a client reads them, with zeros beyond the end of the
        table."""
        meant = self.resolved(address, max(0, min(size, self.SIZE - address)))
        return bytes(self._bytes[place] for place in meant).ljust(size, b"\0")

    def resolved(self, address: int, size: int) -> list[int]:
        """Return the addresses that a read or write of ``size`` bytes at ``address`` refers to."""
        return list(range(address, address + size))

    def write(self, address: int, data: bytes) -> int:
        """Write bytes received over the bus. Return the error number, or 0 if there is no error."""
        meant = self.resolved(address, len(data))
        for begin, end in runs(meant):
            error = self._run_refusal(meant[begin], data[begin:end])
            if error:
                return error
        for place, byte in zip(meant, data, strict=True):
            self._bytes[place] = byte
        if meant and min(meant) < self.EEPROM_END:
            self._decode()
        return 0

    def _run_refusal(self, address: int, data: bytes) -> int:
        """Return the error for writing to these adjacent registers, or 0 if the write is allowed."""
        at = 0
        while at < len(data):
            register = self._registers.get(address + at)
            error = ACCESS if register is None else self._refusal(register, data[at:])
            if register is None or error:
                return error
            at += register.size
        return 0

    def _refusal(self, register: Register, data: bytes) -> int:
        """Return the error for writing the first bytes of ``data`` to a register, or 0 if the write is allowed."""
        locked = register.persistent and self.get(self._torque)
        if register.access is Access.READ or locked:
            return ACCESS
        if len(data) < register.size:
            return DATA_LENGTH
        value = register.decode(data[: register.size], "little")
        if not register.takes(value):
            return DATA_RANGE
        return 0 if value in self._limits(register) else DATA_LIMIT

    def _limits(self, register: Register) -> range:
        """Return the values that other registers currently permit. The value has already been checked against the
        control table's own limits."""
        return register.fitting

    def power_up(self) -> None:
        """Set the power-on values: EEPROM does not change, and RAM is set to its initial values."""
        self._bytes[self.EEPROM_END :] = bytes(self.SIZE - self.EEPROM_END)
        for register, value in self._factory.items():
            if not register.persistent:
                self.put(register, value)

    @property
    def flash(self) -> Flash:
        """Contents of the flash memory."""
        return Flash(bytes(self._bytes[: self.EEPROM_END]))

    @flash.setter
    def flash(self, flash: Flash) -> None:
        self._bytes[: self.EEPROM_END] = flash.settings
        self._decode()
        self.power_up()

    def restore_factory(self, *keep: Register) -> None:
        """Reset the EEPROM to factory values, except for the registers in ``keep``."""
        kept = {register: self.get(register) for register in keep}
        self._bytes[: self.EEPROM_END] = bytes(self.EEPROM_END)
        for register, value in {**self._factory, **kept}.items():
            if register.persistent:
                self.put(register, value)
        self.put(self._number, self._model.number)


def runs(places: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield the start and end indices of each run of consecutive addresses."""
    begin = 0
    for i in range(1, len(places) + 1):
        if i == len(places) or places[i] != places[i - 1] + 1:
            yield begin, i
            begin = i
