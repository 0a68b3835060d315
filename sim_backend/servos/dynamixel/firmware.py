"""Firmware of a virtual X series servo.

From the e-manual:
- The motion profile (``x_profile``), the operating modes, the bus watchdog and the hardware error bits.
- Reverse mode inverts positions, velocities and drive, but not the sign of the homing offset.
- ``moving`` indicates whether the velocity exceeds the moving threshold, and is always 1 while a profile is in
  progress.
- After a shutdown, torque stays disabled until a reboot.
- In PWM mode, the PWM of an XL330 or XC330 changes at the rate of the PWM slope.

``controllers`` contains the control loops, and ``modes`` contains the operating modes. Assumed:
- Current-based position mode works like position mode as long as the current stays below ``goal_current``.
- A current controller has no delay and no error.
- goal_position equals the present position after power-on.

Position values continue beyond one turn. After power-on, the position is within one turn. In position mode, the
position is also within one turn after the torque is enabled or the mode is set. In position mode, a homing offset
beyond 1024 counts is ignored.
"""

from collections.abc import Callable
from typing import Final

from drivers.servos import x
from sim_backend.mechanics.motor import MotorConstants
from sim_backend.servos.dynamixel.controllers import (
    P_DIVISOR,
    PositionLoop,
    VelocityLoop,
    position_gains,
    velocity_gains,
)
from sim_backend.servos.dynamixel.models import follows_42
from sim_backend.servos.dynamixel.modes import CURRENT, CURRENT_POSITION, POSITION_MODES, PWM, VELOCITY
from sim_backend.servos.dynamixel.protocol2_firmware import ErrorBits, Protocol2Firmware
from sim_backend.servos.dynamixel.watchdog import Watchdog, stop
from sim_backend.servos.dynamixel.x_profile import XProfile
from sim_backend.servos.generic.firmware import FirmwareMemory
from sim_backend.servos.generic.motion_profile import UNLIMITED

_MEASURED_P_DIVISORS: Final = {x.XL330_M077.name: 256.0, x.XL330_M288.name: 256.0}
"""Measured scale of the P gain. On an XL330, BAM measured half the drive stated in the e-manual, using an oscilloscope;
the M077 has the same firmware."""
TICKS: Final = 32768
"""Number of different values of ``realtime_tick``."""
_SLOPE_UNIT_V_S: Final = 1.977
"""Unit of the PWM slope, in V/s."""


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

    _model: x.XModel
    profile: XProfile

    def __init__(self, memory: FirmwareMemory, model: x.XModel, motor: MotorConstants) -> None:
        self._p_divisor = _MEASURED_P_DIVISORS.get(model.name, P_DIVISOR)
        self._position_loop, self._velocity_loop = PositionLoop(), VelocityLoop()
        self._has_slope = x.pwm_slope in model.own
        self._wanted: Callable[[float, float], float] = self._position_duty
        """Loop that returns the drive requested by the current operating mode."""
        self._turned = 0.0
        """Whole turns that are no longer included in the servo's position, in counts."""
        self._direction = 1.0
        """Direction of the motor; -1 in reverse mode. All other values use the direction in which the servo counts
        positions."""
        self._watchdog = Watchdog()
        self._tick_s = 0.0
        self._in_profile_mode = True
        super().__init__(memory, model, motor)

    def new_profile(self) -> XProfile:
        return XProfile()

    def observe(self, angle_rad: float) -> None:
        super().observe(angle_rad * self._direction)

    def restart(self) -> None:
        self._tick_s = 0.0
        self._load_direction()
        self._forget_turns()
        super().restart()

    def heard(self) -> None:
        """Record that the servo has received an instruction."""
        self._watchdog.heard()

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        self._tick_s += dt_s
        if self._acting and self._watchdog.expired(dt_s):
            stop(self._memory, self.position, measures_current=self._model.current_unit_a is not None)
            self.load_goal()
        direction = self._direction
        return direction * super().step(dt_s, direction * angle_rad, direction * velocity_rad_s)

    def _load_direction(self) -> None:
        direction = -1.0 if self._memory.get(x.drive_mode) & x.REVERSE else 1.0
        if direction != self._direction:
            self._direction = direction
            self._count = -1.0 - self._count
            self._velocity, self._shown_velocity = -self._velocity, -self._shown_velocity
            self._forget_turns()

    def mode_changed(self) -> None:
        """Start a new operating mode at the current position. Position mode restarts the count of turns."""
        if self._in_position_mode:
            self._forget_turns()
        self._place_seam()
        self._memory.put(x.goal_position, int(self.position))
        self.load_settings()

    def clear_turns(self) -> bool:
        """Restart the count of turns, as the clear instruction does. If the servo is moving, do nothing and return
        False."""
        if self._moving:
            return False
        self._hold_here()
        self.profile.restart(self.position)
        self.load_goal()
        return True

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
        self._load_direction()
        self._place_seam()
        self._multi_turn = True
        self.load_goal()

    def load_goal(self) -> None:
        """Decode the gains, the goals and the torque switch, all of which are in RAM."""
        get = self._memory.get
        gains = (
            x.position_p_gain,
            x.position_i_gain,
            x.position_d_gain,
            x.feedforward_1st_gain,
            x.feedforward_2nd_gain,
        )
        p, i, d, ff_velocity, ff_acceleration = map(get, gains)
        position_gains(self._position_loop, (p, i, d, ff_velocity, ff_acceleration), self._p_divisor)
        velocity_gains(self._velocity_loop, get(x.velocity_p_gain), get(x.velocity_i_gain))
        self._load_profile()
        self._load_mode()
        self._watchdog.load(self._memory)
        acting = get(x.torque_enable) == 1
        if acting and not self._acting and self._in_position_mode:
            self._forget_turns()
        self._acting = acting
        self._switch()

    def _load_profile(self) -> None:
        get, loop = self._memory.get, self._velocity_loop
        velocity, acceleration = get(x.profile_velocity), get(x.profile_acceleration)
        goal = get(x.goal_velocity) * x.VELOCITY_UNIT_COUNTS_S
        self.profile.goal = float(get(x.goal_position))
        if self._is_timed:
            self.profile.take(velocity, acceleration)
            if goal != loop.goal:
                loop.acceleration = abs(goal - loop.trajectory) / acceleration * 1e3 if acceleration else UNLIMITED
        else:
            self.profile.limit(velocity, acceleration)
            loop.acceleration = acceleration * x.ACCELERATION_UNIT_COUNTS_S2 or UNLIMITED
        loop.goal = goal

    @property
    def _is_timed(self) -> bool:
        drive, version = self._memory.get(x.drive_mode), self._memory.get(x.firmware_version)
        return bool(drive & x.TIME_BASED_PROFILE) and follows_42(self._model, version)

    def _load_mode(self) -> None:
        get, mode = self._memory.get, self._memory.get(x.operating_mode)
        controls = {CURRENT: self._current_duty, VELOCITY: self._velocity_duty, PWM: self._pwm_duty}
        self._wanted = controls.get(mode, self._position_duty)
        self._pwm = get(x.goal_pwm) / x.FULL_PWM
        self._limit = get(x.pwm_limit) / x.FULL_PWM
        if mode != PWM:
            self._limit = min(abs(self._pwm), self._limit)
        self._slope_v_s = get(x.pwm_slope) * _SLOPE_UNIT_V_S if self._has_slope else UNLIMITED
        self._in_profile_mode = mode in POSITION_MODES
        unit_a = self._model.current_unit_a
        self._goal_a = UNLIMITED if unit_a is None else get(x.goal_current) * unit_a
        self._largest_a = abs(self._goal_a) if mode == CURRENT_POSITION else UNLIMITED

    def _switch(self) -> None:
        was_driving = self._driving
        super()._switch()
        if self._driving and not was_driving:
            self._position_loop.restart()
            self._velocity_loop.restart(self._velocity)
            self._load_profile()

    def _drive(self, dt_s: float, velocity_rad_s: float) -> float:
        duty = self._wanted(dt_s, velocity_rad_s)
        limit, motor = self._limit, self._motor
        self.duty = duty = max(-limit, min(limit, duty))
        self.current_a = (duty * self.voltage_v - motor.back_emf_v_s * velocity_rad_s) / motor.resistance_ohm
        return motor.torque_constant_nm_a * self.current_a

    def _position_duty(self, dt_s: float, velocity_rad_s: float) -> float:
        profile = self.profile
        profile.step(dt_s)
        duty = self._position_loop.step(dt_s, profile, self._count - self._offset, self._velocity)
        if self._largest_a == UNLIMITED:
            return duty
        highest = self._duty_of(self._largest_a, velocity_rad_s)
        return max(self._duty_of(-self._largest_a, velocity_rad_s), min(highest, duty))

    def _velocity_duty(self, dt_s: float, velocity_rad_s: float) -> float:
        duty = self._velocity_loop.step(dt_s, self._velocity)
        self.profile.restart(self.position)
        self.profile.velocity = self._velocity_loop.trajectory
        return duty

    def _current_duty(self, dt_s: float, velocity_rad_s: float) -> float:
        self.profile.restart(self.position)
        return self._duty_of(self._goal_a, velocity_rad_s)

    def _pwm_duty(self, dt_s: float, velocity_rad_s: float) -> float:
        self.profile.restart(self.position)
        change = self._slope_v_s * dt_s / max(self.voltage_v, 0.1)
        return max(self.duty - change, min(self.duty + change, self._pwm))

    def _duty_of(self, current_a: float, velocity_rad_s: float) -> float:
        """Return the drive that produces the given current."""
        motor = self._motor
        wanted_v = current_a * motor.resistance_ohm + motor.back_emf_v_s * velocity_rad_s
        return wanted_v / max(self.voltage_v, 0.1)

    def publish(self) -> None:
        put = self._memory.put
        put(x.present_pwm, round(self.duty * x.FULL_PWM))
        unit_a = self._model.current_unit_a
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
        put(x.moving_status, self.profile.status(self.position) if self._in_profile_mode else 0)
        put(x.realtime_tick, int(self._tick_s * 1e3) % TICKS)

    @property
    def _moving(self) -> bool:
        in_progress = self._driving and self._in_profile_mode and not self.profile.done
        velocity = round(self._shown_velocity / x.VELOCITY_UNIT_COUNTS_S)
        return in_progress or abs(velocity) > self._memory.get(x.moving_threshold)
