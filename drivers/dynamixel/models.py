"""All Dynamixel models of protocol 2.0, and what a bus must know of the series that a model belongs to."""

import math
from struct import Struct
from typing import Final

from drivers.bus import ServoGoal, ServoState
from drivers.dynamixel import x_series, xl320
from drivers.dynamixel.series import Read, Series, alarmed, blocks
from drivers.registers import Register, ServoModel

_new: Final = tuple.__new__


def _refused(register: Register, value: int) -> bytes:
    """The complaint that a value does not fit, in the register's own words."""
    return register.encode(value, "little")


# X series.

LARGEST_PROFILE: Final = 32767
_VOLTAGES_V: Final = tuple(raw * x_series.VOLTAGE_UNIT_V for raw in range(256))
_X_GOAL: Final = Struct("<Ii")
_MANY: Final = 1 << 31


def x_state(
    unit_a: float | None, alarms: tuple[str, ...],
    pwm: int, current: int, velocity: int, position: int, voltage: int, temperature: int,
) -> ServoState:  # fmt: skip
    """The numbers of an X series servo's registers in our units; ``alarms`` have their names already."""
    fields = (
        position,
        round(velocity * x_series.VELOCITY_UNIT_COUNTS_S),
        pwm / x_series.FULL_PWM,
        _VOLTAGES_V[voltage] if voltage < 256 else voltage * x_series.VOLTAGE_UNIT_V,
        float(temperature),
        alarms,
        None if unit_a is None else current * unit_a,
    )
    return _new(ServoState, fields)


def _x_direct(
    unit_a: float | None, error: int,
    pwm: int, current: int, velocity: int, position: int, voltage: int, temperature: int,
) -> ServoState:  # fmt: skip
    return x_state(unit_a, alarmed(error), pwm, current, velocity, position, voltage, temperature)


def profile_units(velocity_counts_s: int) -> int:
    """A speed as profile_velocity, rounded up: the servo is never slower than asked. 0 stays 0."""
    return min(math.ceil(velocity_counts_s / x_series.VELOCITY_UNIT_COUNTS_S), LARGEST_PROFILE)


def _x_goal(goal: ServoGoal) -> bytes:
    velocity, position = goal.velocity_counts_s, goal.position_counts
    # A small negative velocity would be 0 in the servo's units, which is as fast as it can.
    if velocity >= 0 and -_MANY <= position < _MANY:
        return _X_GOAL.pack(profile_units(velocity), position)
    return _refused(x_series.GOAL_BLOCK[0], velocity) + _refused(x_series.GOAL_BLOCK[1], position)


def _x_misfit(read: Read) -> str | None:
    mode = read(x_series.operating_mode)
    if mode != x_series.POSITION_MODE:
        return f"is in operating mode {mode}: set it to {x_series.POSITION_MODE} (position)"
    drive = read(x_series.drive_mode)
    if drive & x_series.TIME_BASED_PROFILE:
        return "has a time-based profile: clear bit 2 of its drive mode"
    if drive & x_series.TORQUE_ON_BY_GOAL:
        return "switches its torque on by itself: clear bit 3 of its drive mode"
    return None


X: Final = Series(
    name="Dynamixel X",
    models=tuple(x_series.MODELS.values()),
    blocks=blocks(
        (x_series.present_pwm, x_series.moving, x_series.realtime_tick, x_series.goal_position),
        x_series.STATE_BLOCK_END,
        # PWM, current (or load, as the model is), velocity, position, voltage, temperature; between them the
        # trajectory.
        Struct("<hhii8xHB"),
        _x_direct,
        fast=True,
    ),
    goal_address=x_series.GOAL_BLOCK[0].address,
    goal_size=sum(register.size for register in x_series.GOAL_BLOCK),
    goal=_x_goal,
    torque_enable=x_series.torque_enable,
    goal_position=x_series.goal_position,
    position_limits=(x_series.min_position_limit, x_series.max_position_limit),
    hardware_error_status=x_series.hardware_error_status,
    alarms=x_series.alarms,
    # No ramp of the servo's own: the trajectory above is smooth already, and a ramp would stop the servo
    # at every goal.
    before_torque=((x_series.profile_acceleration, 0),),
    position_p=x_series.position_p_gain,
    torque_limit=x_series.goal_pwm,
    torque_ceiling=x_series.pwm_limit,
    full_torque=x_series.FULL_PWM,
    misfit=_x_misfit,
)


# XL-320.

_SIGN: Final = 1 << 10
_XL_GOAL: Final = Struct("<HH")


def _signed(raw: int) -> int:
    """A sign-magnitude number whose sign is bit 10."""
    return -(raw & _SIGN - 1) if raw & _SIGN else raw & _SIGN - 1


def _xl_state(
    _unit_a: None, error: int, position: int, speed: int, load: int, voltage: int, temperature: int
) -> ServoState:
    return ServoState(
        position,
        round(_signed(speed) * xl320.SPEED_UNIT_COUNTS_S),
        _signed(load) / xl320.FULL_TORQUE,
        voltage * xl320.VOLTAGE_UNIT_V,
        float(temperature),
        alarmed(error),
    )


def _xl_goal(goal: ServoGoal) -> bytes:
    position, last = goal.position_counts, xl320.POSITIONS - 1
    if not 0 <= position <= last:
        raise ValueError(f"goal_position takes 0 to {last}, not {position}: nothing written")
    # Rounded up: the servo is never slower than asked, and 0 alone stays 0, as fast as it can.
    speed = min(math.ceil(goal.velocity_counts_s / xl320.SPEED_UNIT_COUNTS_S), xl320.LARGEST_SPEED)
    if goal.velocity_counts_s < 0:
        return _refused(xl320.moving_speed, goal.velocity_counts_s)
    return _XL_GOAL.pack(position, speed)


def _xl_misfit(read: Read) -> str | None:
    mode = read(xl320.control_mode)
    if mode != xl320.JOINT_MODE:
        return f"is in control mode {mode}: set it to {xl320.JOINT_MODE} (joint)"
    return None


XL: Final = Series(
    name="Dynamixel XL-320",
    models=tuple(xl320.MODELS.values()),
    blocks=blocks(
        (xl320.present_position, xl320.torque_limit, xl320.moving_speed, xl320.goal_position),
        xl320.STATE_BLOCK_END,
        Struct("<HHH2xBB"),
        _xl_state,
        fast=False,
    ),
    goal_address=xl320.GOAL_BLOCK[0].address,
    goal_size=sum(register.size for register in xl320.GOAL_BLOCK),
    goal=_xl_goal,
    torque_enable=xl320.torque_enable,
    goal_position=xl320.goal_position,
    position_limits=(xl320.cw_angle_limit, xl320.ccw_angle_limit),
    hardware_error_status=xl320.hardware_error_status,
    alarms=xl320.alarms,
    before_torque=(),
    position_p=xl320.p_gain,
    torque_limit=xl320.torque_limit,
    torque_ceiling=xl320.max_torque,
    full_torque=xl320.FULL_TORQUE,
    misfit=_xl_misfit,
)
SERIES: Final = (X, XL)

MODELS: Final = {model.name: model for series in SERIES for model in series.models}
"""Every Dynamixel model of protocol 2.0 by name."""


def series_of(model: ServoModel) -> Series:
    """The series of one of ``MODELS``; ValueError for another servo."""
    for series in SERIES:
        if model in series.models:
            return series
    raise ValueError(f"{model.name} is no Dynamixel of protocol 2.0: known are {', '.join(MODELS)}")
