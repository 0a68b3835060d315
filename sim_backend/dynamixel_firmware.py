"""What runs inside a virtual X series servo in position mode, in place of the STS servo's.

From the e-manual: the profile; the position loop's structure (a PID on counts that puts out PWM) and
the scale of its gains; the hardware error bits, and that a shutdown clears the torque switch until a
reboot. Assumed:
- one unit of the loop's output is one unit of goal_pwm, one turn of the loop a millisecond;
- feedforward gains do nothing; only position mode drives the motor;
- overload is full drive for two seconds; all errors stay until a reboot;
- present_velocity is smoothed with 15 ms more than what the loop acts on: a shaft that is held between two
  counts is not said to move;
- the position counts on beyond a turn, and goal_position is the present one after power-on.
"""

from typing import Final

from drivers.servos import x
from sim_backend.generic.firmware import GenericFirmware, Memory
from sim_backend.generic.motion_profile import UNLIMITED
from sim_backend.generic.protection import Limits, Protection
from sim_backend.motor import MotorConstants

LOOP_S: Final = 0.001
SHOWN_FILTER_S: Final = 0.015
OVERLOAD_DUTY: Final = 0.98
OVERLOAD_S: Final = 2.0
VOLTAGE: Final = 1 << 0
TEMPERATURE: Final = 1 << 2
OVERLOAD: Final = 1 << 5


def motor_of(model: x.Model) -> MotorConstants:
    """The motor of an X series model; heat as in the STS3215 (assumed)."""
    return MotorConstants.of(model, model.stall_current_a)


class XProtection(Protection):
    """Hardware errors: latched until a reboot; those in ``shutdown`` release the motor."""

    def load(self, memory: Limits) -> None:
        """Take the limits from the registers."""
        self._acts_on = memory.get(x.shutdown)
        self._highest_v = memory.get(x.max_voltage_limit) * x.VOLTAGE_UNIT_V
        self._lowest_v = memory.get(x.min_voltage_limit) * x.VOLTAGE_UNIT_V
        self._hottest_c = memory.get(x.temperature_limit)

    def watch(self, dt_s: float, duty: float, current_a: float, voltage_v: float, temperature_c: float) -> None:
        """One look at the motor, ``dt_s`` after the last one."""
        self._overload_s = self._overload_s + dt_s if abs(duty) >= OVERLOAD_DUTY else 0.0
        if self._overload_s >= OVERLOAD_S:
            self.status |= OVERLOAD
        if not self._lowest_v <= voltage_v <= self._highest_v:
            self.status |= VOLTAGE
        if temperature_c > self._hottest_c:
            self.status |= TEMPERATURE
        self.released = bool(self.status & self._acts_on)


class XFirmware(GenericFirmware):
    """The control loop of one X series servo."""

    def __init__(self, memory: Memory, model: x.Model) -> None:
        super().__init__(memory, model, motor_of(model))

    def new_protection(self) -> Protection:
        return XProtection()

    def observe(self, angle_rad: float) -> None:
        super().observe(angle_rad)
        self._shown_velocity = 0.0
        self._memory.put(x.goal_position, int(self._count) + self._memory.get(x.homing_offset))

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        torque_nm = super().step(dt_s, angle_rad, velocity_rad_s)
        self._shown_velocity += (self._velocity - self._shown_velocity) * dt_s / (SHOWN_FILTER_S + dt_s)
        return torque_nm

    def load_settings(self) -> None:
        get = self._memory.get
        self.protection.load(self._memory)
        self._punch = self._dead_above = self._dead_below = 0.0
        self._offset = -float(get(x.homing_offset))
        self._multi_turn = True
        self.load_goal()

    def load_goal(self) -> None:
        """Decode the gains, the goals and the torque switch: all of that lives in RAM."""
        get, profile = self._memory.get, self.profile
        self._gain = get(x.position_p_gain) / 128.0 / x.FULL_PWM
        self._integral_gain = get(x.position_i_gain) / 65536.0 / x.FULL_PWM / LOOP_S
        self._damping = get(x.position_d_gain) / 16.0 / x.FULL_PWM * LOOP_S
        profile.goal = float(get(x.goal_position))
        profile.speed = get(x.profile_velocity) * x.VELOCITY_UNIT_COUNTS_S or UNLIMITED
        profile.acceleration = get(x.profile_acceleration) * x.ACCELERATION_UNIT_COUNTS_S2 or UNLIMITED
        self._limit = min(abs(get(x.goal_pwm)), get(x.pwm_limit)) / x.FULL_PWM
        self._acting = get(x.torque_enable) == 1 and get(x.operating_mode) == x.POSITION_MODE
        self._switch()

    def _switch(self) -> None:
        if self.protection.released:
            self._memory.put(x.torque_enable, 0)
            self._acting = False
        super()._switch()

    def publish(self) -> None:
        put = self._memory.put
        put(x.present_pwm, round(self.duty * x.FULL_PWM))
        unit_a = x.CURRENT_UNIT_A.get(self._model.name)
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
