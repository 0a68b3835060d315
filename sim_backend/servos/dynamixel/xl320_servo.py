"""One virtual XL-320: protocol 2.0 with a control table that uses ten-bit counts.

The e-manual defines the table, its factory values and units, the control modes, and the gains: P / 8, I * 1000 / 2048
and D * 4 / 1000. BAM measured the drive per unit of P. Assumed:
- I and D use the same unit of drive as P, with times in seconds and errors in counts.
- The motor is driven only in joint mode, and ``punch`` has no effect.
- Readings are limited to the range of the sensor, and after power-on the goal is the present position.
- A shutdown sets the torque limit to 0 and persists until a reboot.
"""

from typing import ClassVar, Final

from drivers.servos import xl320
from sim_backend.mechanics.motor import MotorConstants
from sim_backend.servos.dynamixel.motors import IDENTIFIED
from sim_backend.servos.dynamixel.protocol2_firmware import ErrorBits, Protocol2Firmware
from sim_backend.servos.dynamixel.protocol2_servo import Protocol2Servo, Registers
from sim_backend.servos.dynamixel.xl320_memory import Xl320Memory
from sim_backend.servos.generic.motion_profile import UNLIMITED

DRIVE_PER_RAD: Final = 0.05048
"""Drive per rad for each unit of ``p_gain``, as a fraction of full drive."""
_P_UNIT: Final = 1.0 / 8.0
_I_UNIT: Final = 1000.0 / 2048.0
_D_UNIT: Final = 4.0 / 1000.0


class Xl320Firmware(Protocol2Firmware):
    """Control loop of an XL-320."""

    BITS = ErrorBits(
        xl320.shutdown,
        xl320.min_voltage_limit,
        xl320.max_voltage_limit,
        xl320.temperature_limit,
        xl320.VOLTAGE_UNIT_V,
        voltage=1 << 2,
        temperature=1 << 1,
        overload=1 << 0,
    )

    def __init__(self, memory: Xl320Memory, motor: MotorConstants) -> None:
        super().__init__(memory, xl320.XL320, motor)

    def _hold_here(self) -> None:
        self._memory.put(xl320.goal_position, self._shown)

    def _shut_down(self) -> None:
        self._memory.put(xl320.torque_limit, 0)

    @property
    def _shown(self) -> int:
        return max(0, min(xl320.POSITIONS - 1, int(self._count)))

    def load_settings(self) -> None:
        self.protection.load(self._memory)
        self._punch = self._dead_above = self._dead_below = self._offset = 0.0
        self._multi_turn = True
        self.load_goal()

    def load_goal(self) -> None:
        """Decode the gains, the goals and the torque switch."""
        get, profile = self._memory.get, self.profile
        unit = DRIVE_PER_RAD / _P_UNIT / self._counts_per_rad
        self._gain = get(xl320.p_gain) * _P_UNIT * unit
        self._integral_gain = get(xl320.i_gain) * _I_UNIT * unit
        self._damping = get(xl320.d_gain) * _D_UNIT * unit
        profile.goal = float(get(xl320.goal_position))
        speed = get(xl320.moving_speed) & xl320.LARGEST_SPEED
        profile.speed = speed * xl320.SPEED_UNIT_COUNTS_S or UNLIMITED
        self._limit = min(get(xl320.torque_limit), get(xl320.max_torque)) / xl320.FULL_TORQUE
        self._acting = get(xl320.torque_enable) == 1 and get(xl320.control_mode) == xl320.JOINT_MODE
        self._switch()

    def publish(self) -> None:
        put = self._memory.put
        put(xl320.present_position, self._shown)
        put(xl320.present_speed, round(self._shown_velocity / xl320.SPEED_UNIT_COUNTS_S))
        put(xl320.present_load, round(self.duty * xl320.FULL_TORQUE))
        put(xl320.present_voltage, round(self.voltage_v / xl320.VOLTAGE_UNIT_V))
        put(xl320.present_temperature, round(self.thermometer.temperature_c))
        put(xl320.hardware_error_status, self.protection.status)
        put(xl320.moving, int(self._moving))


class VirtualXl320Servo(Protocol2Servo):
    """An XL-320 on a virtual bus. The XL-320 has no fast reads and no indirect registers."""

    REGISTERS: ClassVar[Registers] = Registers(*xl320.REGISTERS)
    PRESENT_POSITION = xl320.present_position

    def __init__(self, servo_id: int) -> None:
        motor = IDENTIFIED[xl320.XL320.name]
        super().__init__(xl320.XL320, motor.gears)
        self.memory: Xl320Memory = Xl320Memory(servo_id)
        self.firmware: Xl320Firmware = Xl320Firmware(self.memory, motor)
