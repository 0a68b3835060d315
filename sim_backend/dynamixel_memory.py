"""The control table of one virtual X series servo as bytes: who may write what, what power-off forgets.

Factory values are the e-manual's. Assumed: a write that breaks a rule is refused as a whole;
addresses that the table does not list read 0; indirect addresses are not modelled.
"""

from typing import Final

from drivers.dynamixel import x_series as x
from drivers.registers import Access, Register, ServoModel

SIZE: Final = 662
EEPROM_END: Final = x.torque_enable.address

DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = 4, 5, 6, 7
"""Error numbers of a reply."""

FACTORY: Final[dict[Register, int]] = {
    x.firmware_version: 46,  # assumed
    x.servo_id: 1,
    x.baud_rate: 1,
    x.return_delay: 250,
    x.operating_mode: x.POSITION_MODE,
    x.secondary_id: 255,
    x.protocol_type: 2,
    x.moving_threshold: 10,
    x.pwm_limit: x.FULL_PWM,
    x.max_position_limit: 4095,
    x.status_return_level: 2,
}
"""What all models have; every register that is neither here nor in OWN is 0."""

_OWN_REGISTERS: Final = (
    x.temperature_limit,
    x.max_voltage_limit,
    x.min_voltage_limit,
    x.velocity_limit,
    x.shutdown,
    x.velocity_i_gain,
    x.velocity_p_gain,
    x.position_d_gain,
    x.position_i_gain,
    x.position_p_gain,
)
_OWN_VALUES: Final = {
    x.XL330_M077.name: (70, 70, 35, 1620, 53, 400, 40, 0, 400, 400),
    x.XL330_M288.name: (70, 70, 35, 445, 53, 1600, 180, 0, 0, 400),
    x.XC330_T288.name: (70, 140, 55, 320, 52, 1200, 40, 0, 0, 900),
    x.XL430_W250.name: (72, 140, 60, 265, 52, 1000, 100, 4000, 0, 640),
    x.XM430_W350.name: (80, 160, 95, 350, 52, 1920, 100, 0, 0, 800),
}
OWN: Final = {name: dict(zip(_OWN_REGISTERS, values, strict=True)) for name, values in _OWN_VALUES.items()}
CURRENT_LIMITS: Final = {
    x.XL330_M077.name: 1750,
    x.XL330_M288.name: 1750,
    x.XC330_T288.name: 910,
    x.XM430_W350.name: 1193,
}
"""By model name, in the model's unit. The XL430 has none."""


class XMemory:
    """The bytes that the wire sees. EEPROM is saved with every write."""

    def __init__(self, model: ServoModel, servo_id: int) -> None:
        self._model = model
        self._registers = {register.address: register for register in x.registers(model)}
        self._factory = FACTORY | OWN[model.name]
        self._bytes = bytearray(SIZE)
        self.restore_factory()
        self.put(x.servo_id, servo_id)
        self.power_up()

    def get(self, register: Register) -> int:
        """A register's value, decoded."""
        return register.decode(self.read(register.address, register.size), "little")

    def put(self, register: Register, value: int) -> None:
        """The firmware's own write: no access rules; values beyond the range saturate."""
        value = max(register.smallest, min(register.largest, value))
        end = register.address + register.size
        self._bytes[register.address : end] = register.encode(value, "little")

    def read(self, address: int, size: int) -> bytes:
        """``size`` bytes from ``address``; zeros where the table ends."""
        return bytes(self._bytes[address : address + size]).ljust(size, b"\0")

    def write(self, address: int, data: bytes) -> int:
        """A write from the wire; returns the error number, 0 for none."""
        at, end = address, address + len(data)
        while at < end:
            register = self._registers.get(at)
            error = ACCESS if register is None else self._refusal(register, data[at - address :])
            if register is None or error:
                return error
            at += register.size
        self._bytes[address:end] = data
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
        if self._model.name in CURRENT_LIMITS:
            self.put(x.current_limit, CURRENT_LIMITS[self._model.name])
