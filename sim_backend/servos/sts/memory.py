"""Control table of one virtual STS servo: access rules, and the registers that survive power-off.

The firmware works directly on these bytes. Addresses that Feetech's table does not list behave like the adjacent
addresses. The lock register does not prevent writes, but a value written while it is locked is lost at power-off.
"""

from typing import Final

from drivers.servos import sts
from drivers.servos.register import Register, ServoModel
from sim_backend.flash import Flash, Kept
from sim_backend.servos.sts.state import TABLE_SIZE, States

READ_ONLY: Final = frozenset((*range(4), *range(56, 78)))
PERSISTENT: Final = frozenset((*range(4, 40), *range(78, TABLE_SIZE)))
KEPT: Final = Kept(sts.REGISTERS, PERSISTENT - READ_ONLY, "little")
OFFSET_WORD: Final = Register("homing_offset", 31, 2, persistent=True)
"""The homing offset as a word of the table. Bit 11 is the sign, and bit 12 adds 2048 counts."""

FACTORY: Final[dict[Register, int]] = {
    sts.firmware_major: 3,
    sts.firmware_minor: 10,
    sts.status_level: 1,
    sts.max_position: 4095,
    sts.max_temperature: 70,
    sts.max_voltage: 140,
    sts.min_voltage: 40,
    sts.max_torque: 1000,
    sts.phase: 12,  # speeds in counts/s; a speed of 0 means maximum speed
    sts.unloading_condition: 44,  # temperature, current and overload
    sts.led_alarm_condition: 47,
    sts.position_p: 32,
    sts.position_d: 32,
    sts.minimum_startup_force: 16,
    sts.cw_dead_zone: 1,
    sts.ccw_dead_zone: 1,
    sts.protection_current: 310,
    sts.angular_resolution: 1,
    sts.protective_torque: 20,
    sts.protection_time: 200,
    sts.overload_torque: 80,
    sts.velocity_p: 10,
    sts.overcurrent_time: 200,
    sts.velocity_i: 200,
    sts.moving_threshold: 2,
    sts.dts: 20,
    sts.velocity_unit: 50,
    sts.hts: 1,
    sts.max_velocity: 150,
    sts.max_acceleration: 100,
    sts.acceleration_multiplier: 1,
}
"""Factory values. All other registers are 0."""


def offset_word(offset: int) -> int:
    """Return the word that encodes a homing offset (counts), or 0 if the offset is one turn or more."""
    if offset >= 4096:
        return 0
    size, sign = abs(offset), 1 << 11 if offset < 0 else 0
    return (size & 0x7FF) | sign | (1 << 12 if size & 0x800 else 0)


class StsMemory:
    """The control table, its copy in flash memory, and the saved defaults."""

    def __init__(self, model: ServoModel, servo_id: int, states: States) -> None:
        self.work_on(states)
        self.servo_id = servo_id
        self.baud = 0
        """Baud rate in bits per second. The baud rate is decoded at each write, as is the ID, because every packet
        needs both."""
        for register, value in FACTORY.items():
            self.put(register, value)
        self.put(sts.model_number, model.number)
        self.put(sts.servo_id, servo_id)
        self.save_defaults()
        self._saved = bytearray(self._table)
        self.power_up()

    def work_on(self, states: States) -> None:
        """From now on, use the control table in this record."""
        self._table = memoryview(states["table"][0])

    @property
    def answers(self) -> int:
        """Status level. At level 1, the servo replies to pings and reads. At 2, it answers every instruction."""
        return 2 if self.get(sts.status_level) else 1

    def get(self, register: Register) -> int:
        """Return the decoded value of a register."""
        return register.decode(bytes(self._table[register.address : register.address + register.size]), "little")

    def put(self, register: Register, value: int) -> None:
        """Write a register without access rules. The value is lost at power-off."""
        self._table[register.address : register.address + register.size] = register.encode(value, "little")
        self._decode()

    def read(self, address: int, size: int) -> bytes:
        """Return ``size`` bytes starting at ``address``, or fewer at the end of the table."""
        return bytes(self._table[address : address + size])

    def write(self, address: int, data: bytes) -> None:
        """Write bytes that came over the wire. Read-only bytes are not changed."""
        for at, value in enumerate(data[: max(0, TABLE_SIZE - address)], address):
            if at not in READ_ONLY:
                self._write_byte(at, self._corrected(at, value))
        self._decode()

    def save(self, register: Register, value: int) -> None:
        """Write a persistent register so that the value survives power-off, regardless of the lock."""
        self.put(register, value)
        span = slice(register.address, register.address + register.size)
        self._saved[span] = self._table[span]

    def power_up(self) -> None:
        """Restore the saved registers and reset the volatile registers."""
        self._table[:] = self._saved
        for at in set(range(TABLE_SIZE)) - PERSISTENT - set(range(4)):
            self._table[at] = 0
        self.put(sts.lock, 1)
        self.put(sts.torque_limit, self.get(sts.max_torque))

    def save_defaults(self) -> None:
        """Save the current table as the defaults (instruction 9)."""
        self._defaults = bytes(self._table)

    def restore_defaults(self) -> None:
        """Copy the saved defaults to flash memory, except for the ID (instruction 6)."""
        self._saved[:] = self._defaults
        self._saved[sts.servo_id.address] = self.servo_id

    @property
    def flash(self) -> Flash:
        """Contents of the flash memory."""
        return Flash(bytes(self._saved), self._defaults)

    @flash.setter
    def flash(self, flash: Flash) -> None:
        self._saved, self._defaults = bytearray(flash.settings), flash.defaults
        self.power_up()

    @property
    def kept(self) -> Kept:
        """Registers and bytes that survive power-off."""
        return KEPT

    def _write_byte(self, at: int, value: int) -> None:
        self._table[at] = value
        if at in PERSISTENT and not self._table[sts.lock.address]:
            self._saved[at] = value

    def _corrected(self, at: int, value: int) -> int:
        """Correct a written byte as the firmware does. The firmware corrects only these two values."""
        if at == sts.baud_rate.address and value >= len(sts.BAUD_RATES):
            return 0
        return 1 if at == sts.angular_resolution.address and value == 0 else value

    def _decode(self) -> None:
        """Decode the ID and the baud rate."""
        self.servo_id = self._table[sts.servo_id.address]
        self.baud = sts.BAUD_RATES[self._table[sts.baud_rate.address]]
