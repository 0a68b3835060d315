"""Firmware of a virtual servo other than STS: motion profile, position loop, motor driver and protection.

Register names are those of the STS table; the memory of each series maps these names to its own registers. The
manufacturers publish neither the structure of the loop nor the scale of its gains (except Robotis for the X series,
which uses different gains). Assumed for the other servos:
- P: the drive is ``P / 1280`` of full drive per count of error. Therefore, P = 32 results in full drive at 40 of 4096
  counts (3.5 degrees). At a constant 2 rad/s, the shaft then lags 13 ms behind the servo's own profile.
- D: the drive is ``0.3 * D / 32`` of full drive per rad/s of difference between the profile speed and the measured
  speed.
- I: ``I / 1280`` of full drive per count and second.
- Position and speed come from the quantized encoder, which is also the source of their noise. The speed is filtered
  with a time constant of 5 ms.
- Only operating mode 0 (position) drives the motor.
- In single-turn mode, the loop works in the range 0 to 4095 counts and reaches every goal without crossing the seam.
"""

from math import pi
from typing import Final, Protocol

from drivers.servos import sts
from drivers.servos.register import Register, ServoModel
from sim_backend.mechanics.motor import MotorConstants, Thermometer
from sim_backend.servos.generic.motion_profile import UNLIMITED, MotionProfile
from sim_backend.servos.generic.protection import Protection

GAIN_UNIT: Final = 1.0 / 1280.0
DAMPING_PER_RAD_S: Final = 0.3 / 32.0
SPEED_FILTER_S: Final = 0.005
HOUSEKEEPING_S: Final = 0.01
MOVING_COUNTS_S: Final = 20.0
"""Maximum speed at which the servo is considered at rest (assumed; real servos store this threshold at address 80)."""
MULTI_TURN_PHASE: Final = 1 << 4


class FirmwareMemory(Protocol):
    """The part of the control table that the firmware uses."""

    def get(self, register: Register) -> int: ...

    def put(self, register: Register, value: int) -> None: ...


class GenericFirmware:
    """Control loop of one servo. ``step`` is called at a fixed rate and must be fast."""

    def __init__(self, memory: FirmwareMemory, model: ServoModel, motor: MotorConstants) -> None:
        self._memory = memory
        self._model = model
        self._motor = motor
        self._turn = float(model.counts_per_turn)
        self._counts_per_rad = self._turn / (2.0 * pi)
        self._no_load = model.no_load_speed_rad_s
        self.voltage_v = model.rated_voltage_v
        self.thermometer = Thermometer(motor)
        self.encoder_sticks = False
        """Whether the encoder repeats its last value. This injected fault persists after power-off."""
        self.observe(0.0)
        self.restart()

    @property
    def temperature_c(self) -> float:
        """Motor temperature, in degrees Celsius."""
        return self.thermometer.temperature_c

    @temperature_c.setter
    def temperature_c(self, temperature_c: float) -> None:
        self.thermometer.temperature_c = temperature_c

    @property
    def supply_current_a(self) -> float:
        """Current that the motor draws from the supply, in amperes. Braking does not return current to the supply
        (assumed)."""
        return max(0.0, self.current_a * self.duty)

    def observe(self, angle_rad: float) -> None:
        """Set the shaft angle without simulating a motion, for example at power-on."""
        self._count = angle_rad * self._counts_per_rad // 1.0
        self._velocity = 0.0

    def restart(self) -> None:
        """Restart as after power-on: load the state from the registers, with the torque disabled."""
        self.profile = self.new_profile()
        self.protection = self.new_protection()
        self.duty = self.current_a = self._integral = self._housekeeping_s = 0.0
        self._acting = self._driving = False
        self.load_settings()
        self.load_goal()

    def new_profile(self) -> MotionProfile:
        """Return a motion profile in its power-on state."""
        return MotionProfile()

    def new_protection(self) -> Protection:
        """Return a motor protection in its power-on state."""
        return Protection()

    def load_settings(self) -> None:
        """Decode the EEPROM registers once, instead of in every step."""
        get = self._memory.get
        self.protection.load(self._memory)
        self._gain = get(sts.position_p) * GAIN_UNIT
        self._integral_gain = get(sts.position_i) * GAIN_UNIT
        self._damping = get(sts.position_d) * DAMPING_PER_RAD_S / self._counts_per_rad
        self._punch = get(sts.minimum_startup_force) * sts.TORQUE_UNIT
        self._dead_above = float(get(sts.cw_dead_zone))
        self._dead_below = -float(get(sts.ccw_dead_zone))
        self._offset = float(get(sts.homing_offset))
        self._lowest, self._highest = get(sts.min_position), get(sts.max_position)
        unlimited = self._lowest == self._highest == 0
        self._multi_turn = unlimited or bool(get(sts.phase) & MULTI_TURN_PHASE)
        self.load_goal()

    def load_goal(self) -> None:
        """Decode the goals and the torque switch."""
        get = self._memory.get
        goal, profile = get(sts.goal_position), self.profile
        if self._lowest < self._highest:
            goal = min(max(goal, self._lowest), self._highest)
        profile.goal = float(goal)
        profile.speed = abs(get(sts.goal_velocity)) or self._no_load * self._counts_per_rad
        units = get(sts.acceleration)
        profile.acceleration = units * sts.ACCELERATION_UNIT_COUNTS_S2 if units else UNLIMITED
        # At power-on, the table copies max_torque to torque_limit, so the limit is the smaller of the two values rather
        # than their product.
        self._limit = min(get(sts.torque_limit), get(sts.max_torque)) * sts.TORQUE_UNIT
        self._acting = get(sts.torque_enable) == 1 and get(sts.operating_mode) == 0
        self._switch()

    def goal_written(self) -> None:
        """Clear a latched protection if the new goal leads away from the direction in which the servo was blocked."""
        if (self.profile.goal - self.position) * self.protection.blocked_direction <= 0.0:
            self.torque_written()

    def torque_written(self) -> None:
        """Clear a latched protection, as does any write to the torque switch."""
        self.protection.clear()
        self._switch()

    def _switch(self) -> None:
        """Switch the motor on or off. When the motor is switched on, the profile starts at the position of the
        shaft."""
        driving = self._acting and not self.protection.released
        if driving and not self._driving:
            self.profile.restart(self.position)
            self._integral = 0.0
        self._driving = driving

    @property
    def status(self) -> int:
        """Protection status bits, as sent in every reply."""
        return self.protection.status

    @property
    def position(self) -> float:
        """Position that the servo reports, in counts."""
        position = self._count - self._offset
        return position if self._multi_turn else position % self._turn

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        """Run the loop once with the true state of the shaft. Return the torque on the shaft (N m)."""
        count = self._count if self.encoder_sticks else angle_rad * self._counts_per_rad // 1.0
        measured = self._velocity
        measured += ((count - self._count) / dt_s - measured) * (dt_s / (SPEED_FILTER_S + dt_s))
        self._velocity = measured
        self._count = count
        torque = self._drive(dt_s, velocity_rad_s) if self._driving else self._coast()
        self._housekeeping_s += dt_s
        if self._housekeeping_s >= HOUSEKEEPING_S:
            self._housekeeping()
        return torque

    def _coast(self) -> float:
        self.duty = self.current_a = 0.0
        return 0.0

    def _drive(self, dt_s: float, velocity_rad_s: float) -> float:
        """Advance the profile, the position loop and the motor."""
        profile = self.profile
        profile.step(dt_s)
        position = self._count - self._offset
        error = profile.position - (position if self._multi_turn else position % self._turn)
        if self._dead_below <= error <= self._dead_above:
            error = 0.0
        duty = self._gain * error + self._damping * (profile.velocity - self._velocity)
        if self._integral_gain:
            self._integral += self._integral_gain * error * dt_s
            self._integral = min(max(self._integral, -1.0), 1.0)
            duty += self._integral
        if self._punch and error and abs(duty) < self._punch:
            duty = self._punch if error > 0.0 else -self._punch
        limit = min(self._limit, self.protection.duty_limit)
        duty = max(-limit, min(limit, duty))
        self.duty = duty
        motor = self._motor
        self.current_a = (duty * self.voltage_v - motor.back_emf_v_s * velocity_rad_s) / motor.resistance_ohm
        return motor.torque_constant_nm_a * self.current_a

    def _housekeeping(self) -> None:
        """Update the temperature and the protection, which is not necessary in every step."""
        dt_s, self._housekeeping_s = self._housekeeping_s, 0.0
        self.thermometer.step(dt_s, self.current_a)
        temperature = self.thermometer.temperature_c
        self.protection.watch(dt_s, self.duty, self.current_a, self.voltage_v, temperature)
        self._switch()

    def publish(self) -> None:
        """Write the state to the registers, so that it can be read."""
        put = self._memory.put
        put(sts.present_position, int(self.position))
        put(sts.present_velocity, round(self._velocity))
        put(sts.present_load, round(self.duty / sts.TORQUE_UNIT))
        put(sts.present_voltage, round(self.voltage_v / sts.VOLTAGE_UNIT_V))
        put(sts.present_temperature, round(self.thermometer.temperature_c))
        put(sts.present_current, round(self.current_a / sts.CURRENT_UNIT_A))
        put(sts.status, self.protection.status)
        put(sts.moving, int(self._moving))

    @property
    def _moving(self) -> bool:
        interpolating = self._driving and not self.profile.done
        return interpolating or abs(self._velocity) > MOVING_COUNTS_S
