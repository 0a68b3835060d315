"""The control table of one virtual X series servo as bytes: who may write what, what power-off forgets.

Assumed: a write that breaks a rule is refused as a whole; addresses that the table does not list read 0.
Of indirect addresses see ``dynamixel_indirect``.
"""

from typing import Final

from drivers.servos import x
from drivers.servos.register import Access, Register
from sim_backend.dynamixel_indirect import cells, pointers, resolved, runs, windows_of
from sim_backend.dynamixel_models import FACTORY, factory_of
from sim_backend.generic.memory import saturated

SIZE: Final = 662
EEPROM_END: Final = x.torque_enable.address

DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = 4, 5, 6, 7
"""Error numbers of a reply."""


class XMemory:
    """The bytes that the wire sees. EEPROM is saved with every write."""

    def __init__(self, model: x.Model, servo_id: int, firmware: int | None = None) -> None:
        """``firmware`` is the version, if not the usual one."""
        self._model = model
        version = FACTORY[x.firmware_version] if firmware is None else firmware
        self._windows = windows_of(model, version)
        self._pointers = dict(pointers(self._windows))
        self._last_cell = max(self._pointers.values())
        listed = (*x.registers(model), *self._pointers, *cells(self._windows))
        self._registers = {register.address: register for register in listed}
        self._factory = factory_of(model) | self._pointers | {x.firmware_version: version}
        self._bytes = bytearray(SIZE)
        self.servo_id = servo_id
        self.baud = 0
        """Bits per second. Decoded with each write: every packet on the line is held against these two."""
        self.restore_factory()
        self.put(x.servo_id, servo_id)
        self.power_up()

    def get(self, register: Register) -> int:
        """A register's value, decoded."""
        end = register.address + register.size
        return register.decode(bytes(self._bytes[register.address : end]), "little")

    def put(self, register: Register, value: int) -> None:
        """The firmware's own write: no access rules; values beyond the range saturate."""
        at = register.address
        self._bytes[at : at + register.size] = saturated(register, value, "little")
        if at < EEPROM_END:
            self._decode()

    def _decode(self) -> None:
        """Take ID and baud from the registers."""
        self.servo_id, self.baud = self.get(x.servo_id), x.BAUD_RATES[self.get(x.baud_rate)]

    def read(self, address: int, size: int) -> bytes:
        """``size`` bytes from ``address``, as the wire sees them; zeros where the table ends."""
        if address + size <= self._windows[0].data or address >= SIZE:
            return bytes(self._bytes[address : address + size]).ljust(size, b"\0")
        meant = self.resolved(address, min(size, SIZE - address))
        return bytes(self._bytes[place] for place in meant).ljust(size, b"\0")

    def resolved(self, address: int, size: int) -> list[int]:
        """The addresses that ``size`` bytes from ``address`` stand for."""
        return resolved(self._windows, self._bytes, address, size)

    def write(self, address: int, data: bytes) -> int:
        """A write from the wire; returns the error number, 0 for none."""
        meant = self.resolved(address, len(data))
        for begin, end in runs(meant):
            error = self._run_refusal(meant[begin], data[begin:end])
            if error:
                return error
        for place, byte in zip(meant, data, strict=True):
            self._bytes[place] = byte
        if meant and min(meant) < EEPROM_END:
            self._decode()
        return 0

    def _run_refusal(self, address: int, data: bytes) -> int:
        """Why these registers in one piece must not be written; 0 if they may."""
        at = 0
        while at < len(data):
            register = self._registers.get(address + at)
            error = ACCESS if register is None else self._refusal(register, data[at:])
            if register is None or error:
                return error
            at += register.size
        return 0

    def _refusal(self, register: Register, data: bytes) -> int:
        """Why the bytes at the beginning of ``data`` must not be written; 0 if they may."""
        locked = register.persistent and self.get(x.torque_enable)
        if register.access is Access.READ or locked:
            return ACCESS
        if len(data) < register.size:
            return DATA_LENGTH
        value = register.decode(data[: register.size], "little")
        lowest, highest, error = self._bounds(register)
        return 0 if lowest <= value <= highest else error

    def _bounds(self, register: Register) -> tuple[int, int, int]:
        """The smallest and the largest value, and the error beyond them."""
        if register == x.goal_position and self.get(x.operating_mode) == x.POSITION_MODE:
            return self.get(x.min_position_limit), self.get(x.max_position_limit), DATA_LIMIT
        if register == x.goal_pwm:
            return -self.get(x.pwm_limit), self.get(x.pwm_limit), DATA_LIMIT
        if register in self._pointers:
            return EEPROM_END, self._last_cell, DATA_RANGE
        highest = {
            x.servo_id: 252,
            x.baud_rate: len(x.BAUD_RATES) - 1,
            x.pwm_limit: x.FULL_PWM,
            x.torque_enable: 1,
            x.status_return_level: 2,
            x.profile_acceleration: 32767,
            x.profile_velocity: 32767,
        }
        return register.smallest, highest.get(register, register.largest), DATA_RANGE

    def power_up(self) -> None:
        """What the servo holds after power-on: EEPROM as it was, initial values in RAM."""
        self._bytes[EEPROM_END:] = bytes(SIZE - EEPROM_END)
        for register, value in self._factory.items():
            if not register.persistent:
                self.put(register, value)
        self.put(x.goal_pwm, self.get(x.pwm_limit))
        self.put(x.goal_velocity, self.get(x.velocity_limit))

    def restore_factory(self, *keep: Register) -> None:
        """EEPROM to factory values, but for what is kept."""
        kept = {register: self.get(register) for register in keep}
        self._bytes[:EEPROM_END] = bytes(EEPROM_END)
        for register, value in (self._factory | kept).items():
            if register.persistent:
                self.put(register, value)
        self.put(x.model_number, self._model.number)
