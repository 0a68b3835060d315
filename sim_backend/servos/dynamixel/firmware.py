"""Firmware of a virtual X series servo in position mode.

From the e-manual:
- The motion profile and the hardware error bits.
- The position loop, which is a PID on counts with PWM as its output, and the scale of its gains.
- A shutdown clears the torque switch until a reboot.

Assumed:
- One unit of the loop's output is one unit of goal_pwm, and the loop runs once per millisecond.
- Feedforward gains have no effect, and only position mode and extended position mode drive the motor.
- goal_position equals the present position after power-on.

The position continues beyond a turn. It starts within one turn at power-on. In position mode it also does so when the
torque is enabled or the mode is set, and a homing offset beyond 1024 counts is ignored.
"""

from typing import Final

from drivers.servos import x
from sim_backend.mechanics.motor import MotorConstants
from sim_backend.servos.dynamixel.protocol2_firmware import ErrorBits, Protocol2Firmware
from sim_backend.servos.generic.firmware import FirmwareMemory
from sim_backend.servos.generic.motion_profile import UNLIMITED

LOOP_S: Final = 0.001
P_DIVISOR: Final = 128.0
"""Scale of the P gain in the e-manual."""
_MEASURED_P_DIVISORS: Final = {x.XL330_M077.name: 256.0, x.XL330_M288.name: 256.0}
"""Scale of the P gain as measured. BAM's oscilloscope saw half the drive of the e-manual on an XL330; the M077 has the
same firmware."""

_DRIVING: Final = (x.POSITION_MODE, x.EXTENDED_POSITION_MODE)


class XFirmware(Protocol2Firmware):
    """Control loop of one X series servo."""

    BITS = ErrorBits(
        x.shutdown,
        x.min_voltage_limit,
        x.max_voltage_limit,
        x.temperature_limit,
        x.VOLTAGE_UNIT_V,
        voltage=1 << 0,
        temperature=1 << 2,
        overload=1 << 5,
    )

    def __init__(self, memory: FirmwareMemory, model: x.XModel, motor: MotorConstants) -> None:
        self._p_divisor = _MEASURED_P_DIVISORS.get(model.name, P_DIVISOR)
        self._turned = 0.0
        """Whole turns that the servo has forgotten, in counts."""
        super().__init__(memory, model, motor)

    def restart(self) -> None:
        self._forget_turns()
        super().restart()

    def forget_turns(self) -> None:
        """Restart the count of turns, as position mode does when it is set."""
        self._forget_turns()
        self.load_settings()

    def _forget_turns(self) -> None:
        self._turned = self._count // self._turn * self._turn
        self._place_seam()

    def _place_seam(self) -> None:
        added = self._memory.get(x.homing_offset)
        if self._in_position_mode and abs(added) > x.LARGEST_OFFSET_OF_POSITION_MODE:
            added = 0
        self._offset = self._turned - added

    @property
    def _in_position_mode(self) -> bool:
        return self._memory.get(x.operating_mode) == x.POSITION_MODE

    def _hold_here(self) -> None:
        self._forget_turns()
        self._memory.put(x.goal_position, int(self._count - self._offset))

    def _shut_down(self) -> None:
        self._memory.put(x.torque_enable, 0)

    def load_settings(self) -> None:
        self.protection.load(self._memory)
        self._punch = self._dead_above = self._dead_below = 0.0
        self._place_seam()
        self._multi_turn = True
        self.load_goal()

    def load_goal(self) -> None:
        """Decode gains, goals and torque switch, all of which are in RAM."""
        get, profile = self._memory.get, self.profile
        self._gain = get(x.position_p_gain) / self._p_divisor / x.FULL_PWM
        self._integral_gain = get(x.position_i_gain) / 65536.0 / x.FULL_PWM / LOOP_S
        self._damping = get(x.position_d_gain) / 16.0 / x.FULL_PWM * LOOP_S
        profile.goal = float(get(x.goal_position))
        profile.speed = get(x.profile_velocity) * x.VELOCITY_UNIT_COUNTS_S or UNLIMITED
        profile.acceleration = get(x.profile_acceleration) * x.ACCELERATION_UNIT_COUNTS_S2 or UNLIMITED
        self._limit = min(abs(get(x.goal_pwm)), get(x.pwm_limit)) / x.FULL_PWM
        acting = get(x.torque_enable) == 1 and get(x.operating_mode) in _DRIVING
        if acting and not self._acting and self._in_position_mode:
            self._forget_turns()
        self._acting = acting
        self._switch()

    def publish(self) -> None:
        put = self._memory.put
        put(x.present_pwm, round(self.duty * x.FULL_PWM))
        unit_a = x.current_unit_a(self._model)
        if unit_a is None:
            put(x.present_load, round(self.duty * 1000.0))
        else:
            put(x.present_current, round(self.current_a / unit_a))
        put(x.present_velocity, round(self._shown_velocity / x.VELOCITY_UNIT_COUNTS_S))
        put(x.present_position, int(self.position))
        put(x.velocity_trajectory, round(self.profile.velocity / x.VELOCITY_UNIT_COUNTS_S))
        put(x.position_trajectory, round(self.profile.position))
        put(x.present_voltage, round(self.voltage_v / x.VOLTAGE_UNIT_V))
        put(x.present_temperature, round(self.thermometer.temperature_c))
        put(x.hardware_error_status, self.protection.status)
        put(x.moving, int(self._moving))
