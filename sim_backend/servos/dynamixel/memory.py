"""Control table of one virtual X series servo. ``indirect`` describes the indirect addresses of the servo."""

from typing import Final

from drivers.servos import x
from drivers.servos.register import Register
from sim_backend.flash import Flash
from sim_backend.servos.dynamixel.indirect import cells, pointers, resolved, windows_of
from sim_backend.servos.dynamixel.models import FACTORY, factory_of, reads_fast
from sim_backend.servos.dynamixel.modes import GAINS, reset_gains, reset_goals
from sim_backend.servos.dynamixel.protocol2_memory import DATA_RANGE, Protocol2Memory
from sim_backend.servos.dynamixel.watchdog import LOCKED, TRIPPED

_NEWER: Final = (x.startup_configuration, x.backup_ready)
"""Registers that old firmware versions do not have."""
_LIMITS: Final = {
    x.goal_pwm: x.pwm_limit,
    x.goal_current: x.current_limit,
    x.goal_velocity: x.velocity_limit,
}
"""Registers that limit both positive and negative goals."""


class XMemory(Protocol2Memory):
    """A control table with data registers that mirror other bytes."""

    SIZE = 662
    EEPROM_END = x.torque_enable.address
    BAUD_RATES = x.BAUD_RATES

    def __init__(self, model: x.XModel, servo_id: int, firmware: int | None = None) -> None:
        """Create the table. ``firmware`` is the firmware version, if it differs from the usual version."""
        version = FACTORY[x.firmware_version] if firmware is None else firmware
        self._windows = windows_of(model, version)
        self._pointers = dict(pointers(self._windows))
        self._backup: tuple[bytes, dict[Register, int]] | None = None
        """EEPROM values and gains saved by the backup instruction."""
        known = [r for r in x.registers(model) if reads_fast(model, version) or r not in _NEWER]
        registers = (*known, *self._pointers, *cells(self._windows))
        factory = factory_of(model) | self._pointers | {x.firmware_version: version}
        super().__init__(model, servo_id, registers, factory)

    def read(self, address: int, size: int) -> bytes:
        if address + size <= self._windows[0].data:  # Most reads do not include any data registers.
            return bytes(self._bytes[address : address + size])
        return super().read(address, size)

    def resolved(self, address: int, size: int) -> list[int]:
        return resolved(self._windows, self._bytes, address, size)

    def _refusal(self, register: Register, data: bytes) -> int:
        if register in LOCKED and self.get(x.bus_watchdog) == TRIPPED:
            return DATA_RANGE
        return super()._refusal(register, data)

    def _limits(self, register: Register) -> range:
        if register == x.goal_position and self.get(x.operating_mode) == x.POSITION_MODE:
            return range(self.get(x.min_position_limit), self.get(x.max_position_limit) + 1)
        limit = _LIMITS.get(register)
        if limit is None:
            return super()._limits(register)
        largest = self.get(limit)
        return range(-largest, largest + 1)

    def save(self, register: Register, value: int) -> None:
        super().save(register, value)
        if register == x.operating_mode:
            self.reset_mode()

    def power_up(self) -> None:
        super().power_up()
        self._reset_goals()
        if self._backup is not None:
            self.put(x.backup_ready, 1)
            if self.get(x.startup_configuration) & x.STARTUP_RESTORE:
                for register, value in self._backup[1].items():
                    self.put(register, value)

    def store_backup(self) -> bool:
        """Store the EEPROM values and the gains. If torque is enabled, do nothing and return False (assumed)."""
        if self.get(x.torque_enable):
            return False
        self._backup = self.flash.settings, {register: self.get(register) for register in GAINS}
        self.put(x.backup_ready, 1)
        return True

    def restore_backup(self) -> bool:
        """Restore the EEPROM. If there is no backup or torque is enabled, do nothing and return False."""
        if self._backup is None or self.get(x.torque_enable):
            return False
        self.flash = Flash(self._backup[0])
        return True

    def reset_mode(self) -> None:
        """Write the values to which registers are reset when the operating mode changes."""
        reset_gains(self, self._factory)
        self._reset_goals()

    def _reset_goals(self) -> None:
        reset_goals(self, measures_current=x.goal_current in self._registers.values())
