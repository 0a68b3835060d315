"""Control table of a virtual XL-320, with factory values from the e-manual."""

from typing import Final

from drivers.servos import xl320
from drivers.servos.register import Register
from sim_backend.servos.dynamixel.protocol2_memory import Protocol2Memory

FACTORY: Final[dict[Register, int]] = {
    xl320.firmware_version: 29,  # assumed
    xl320.servo_id: 1,
    xl320.baud_rate: 3,
    xl320.return_delay: 250,
    xl320.ccw_angle_limit: xl320.POSITIONS - 1,
    xl320.control_mode: xl320.JOINT_MODE,
    xl320.temperature_limit: 65,
    xl320.min_voltage_limit: 60,
    xl320.max_voltage_limit: 90,
    xl320.max_torque: xl320.FULL_TORQUE,
    xl320.status_return_level: 2,
    xl320.shutdown: 3,
    xl320.p_gain: 32,
    xl320.punch: 32,
}
"""Factory values. All other registers are 0."""


class Xl320Memory(Protocol2Memory):
    """Control table of the XL-320."""

    SIZE = xl320.punch.address + xl320.punch.size
    EEPROM_END = xl320.torque_enable.address
    BAUD_RATES = xl320.BAUD_RATES

    def __init__(self, servo_id: int) -> None:
        super().__init__(xl320.XL320, servo_id, xl320.REGISTERS, FACTORY)

    def _limits(self, register: Register) -> range:
        if register == xl320.goal_position and self.get(xl320.control_mode) == xl320.JOINT_MODE:
            return range(self.get(xl320.cw_angle_limit), self.get(xl320.ccw_angle_limit) + 1)
        return super()._limits(register)

    def power_up(self) -> None:
        super().power_up()
        self.put(xl320.torque_limit, self.get(xl320.max_torque))
