"""The Dynamixel series with protocol 2.0: the wire protocol, and the encoding of states and goals."""

from functools import partial
from math import ceil
from struct import Struct
from typing import Final

from dynamixel_sdk import Protocol2PacketHandler

from drivers.protocol import v2
from drivers.servos import x, xl320
from drivers.servos.register import ServoModel, bit_names
from drivers.servos.series import Read, Series, WireProtocol, bit_10_goal_of, bit_10_state, blocks_to_end
from drivers.types import ServoGoal, ServoState

ALARMED: Final = ("hardware error",)
"""Alarm reported by the alert bit of a reply. The type of error is in a register that not every block contains."""

PROTOCOL_2: Final = WireProtocol(
    name="Dynamixel protocol 2.0",
    packets=v2,
    byte_order="little",
    sdk=Protocol2PacketHandler,
    group_read="sync",
    waits_for_silent=True,  # DynamixelSDK issues 331 and 364
    refusals=0xFF & ~v2.ALERT,
    refusal=v2.error_text,
    arrived_corrupt=lambda number: number == v2.CORRUPT_PACKET,
    reboot="acknowledged",
    factory_reset=bytes((v2.KEEP_ID_AND_BAUD,)),
    broadcast_ping=True,
)

_new: Final = tuple.__new__


def alarmed(error: int) -> tuple[str, ...]:
    return ALARMED if error & v2.ALERT else ()


# X series.

LARGEST_PROFILE: Final = x.profile_velocity.largest
# Python looks up constants of this module faster than those of another module. A comparison is faster than ``check``.
_LOWEST, _HIGHEST = x.goal_position.smallest, x.goal_position.largest
_VELOCITY_COUNTS_S: Final = x.VELOCITY_UNIT_COUNTS_S
_VOLTAGE_V: Final = x.VOLTAGE_UNIT_V
_FULL_PWM: Final = x.FULL_PWM
_ALARMS: Final = tuple(map(x.alarms, range(256)))
"""Names of the alarms by hardware error."""


def x_state(unit_a: float | None, error: int, *numbers: int) -> ServoState:
    """Convert the register values of an X-series servo to a state. Each control cycle calls this for every servo.

    Args:
        unit_a: Unit of the current, in A; None if the servo does not measure it.
        error: Error byte of the reply.
        *numbers: Numbers of a mapped block: first proof, hardware error, PWM, current or load, velocity, position,
            voltage, temperature and last proof.

    Returns:
        The state, in the units of ``ServoState``.
    """
    _, hardware_error, pwm, current, velocity, position, voltage, temperature, _ = numbers
    fields = (
        position,
        round(velocity * _VELOCITY_COUNTS_S),
        pwm / _FULL_PWM,
        voltage * _VOLTAGE_V,
        float(temperature),
        _ALARMS[hardware_error] if hardware_error or not error else alarmed(error),
        None if unit_a is None else current * unit_a,
    )
    return _new(ServoState, fields)


def _x_direct(unit_a: float | None, error: int, *numbers: int) -> ServoState:
    return x_state(unit_a, error, 0, 0, *numbers, 0)


def _x_goal(wanted: ServoGoal) -> tuple[int, ...]:
    position, velocity = wanted
    if not (_LOWEST <= position <= _HIGHEST and 0 <= velocity <= LARGEST_PROFILE):
        x.goal_position.check(position)
        x.profile_velocity.check(velocity)  # a small negative velocity would become 0, which means maximum velocity
    return ceil(velocity / _VELOCITY_COUNTS_S), position


def _x_config_error(model: ServoModel, read: Read) -> str | None:
    mode = read(x.operating_mode)
    if mode not in (x.POSITION_MODE, *x.MODES_WITH_TURNS):
        return f"is in operating mode {mode}: {_mode_advice(read(x.homing_offset))}"
    drive = read(x.drive_mode)
    if drive & x.TIME_BASED_PROFILE:
        return "has a time-based profile: clear bit 2 of its drive_mode"
    if drive & x.TORQUE_ON_BY_GOAL:
        return "enables its torque at every goal: clear bit 3 of its drive_mode"
    return None


def _mode_advice(homing_offset: int) -> str:
    if not x.needs_extended_position(homing_offset):
        return f"set it to {x.POSITION_MODE} (position)"
    return (
        f"set it to {x.EXTENDED_POSITION_MODE} (extended position), because position mode would ignore its "
        f"homing_offset of {homing_offset}"
    )


X: Final = Series(
    name="Dynamixel X",
    make="dynamixel",
    protocol=PROTOCOL_2,
    by_name=x.MODELS,
    registers=x.REGISTERS,
    goal_block=x.GOAL_BLOCK,
    blocks=blocks_to_end(
        (x.present_pwm, x.moving, x.realtime_tick, x.goal_position),
        x.STATE_BLOCK_END,
        # The fields are PWM, current or load, velocity, position, voltage and temperature. The 8 skipped bytes hold the
        # trajectory.
        Struct("<hhii8xHB"),
        _x_direct,
        fast=True,
    ),
    goal_fields="Ii",
    goal_of=lambda model: _x_goal,
    scale_of=x.current_unit_a,
    servo_id=x.servo_id,
    model_number=x.model_number,
    status_level=x.status_return_level,
    answers_all=2,
    torque_enable=x.torque_enable,
    goal_position=x.goal_position,
    position_limits=(x.min_position_limit, x.max_position_limit),
    max_torque=x.pwm_limit,
    torque_limit=x.goal_pwm,
    full_torque=x.FULL_PWM,
    config_error=_x_config_error,
    # The servo's own ramp is switched off, because it would stop the servo at every goal. The trajectories are already
    # smooth.
    before_torque=((x.profile_acceleration, 0),),
    torque_by_goal=False,  # _x_config_error rejects servos with this setting
    position_p=x.position_p_gain,
    hardware_error=(x.hardware_error_status, x.alarms),
)


# XL-320.


def _xl_state(_scale: None, error: int, *numbers: int) -> ServoState:
    return bit_10_state(xl320.SPEED_UNIT_COUNTS_S, alarmed(error), numbers)


def _xl_config_error(model: ServoModel, read: Read) -> str | None:
    mode = read(xl320.control_mode)
    if mode != xl320.JOINT_MODE:
        return f"is in control mode {mode}: set it to {xl320.JOINT_MODE} (joint)"
    return None


XL: Final = Series(
    name="Dynamixel XL-320",
    make="dynamixel",
    protocol=PROTOCOL_2,
    by_name=xl320.MODELS,
    registers=xl320.REGISTERS,
    goal_block=xl320.GOAL_BLOCK,
    blocks=blocks_to_end(
        (xl320.present_position, xl320.torque_limit, xl320.moving_speed, xl320.goal_position),
        xl320.STATE_BLOCK_END,
        Struct("<HHH2xBB"),
        _xl_state,
        fast=False,
    ),
    goal_fields="HH",
    goal_of=lambda model: bit_10_goal_of(model.last_count, xl320.SPEED_UNIT_COUNTS_S),
    servo_id=xl320.servo_id,
    model_number=xl320.model_number,
    status_level=xl320.status_return_level,
    answers_all=2,
    torque_enable=xl320.torque_enable,
    goal_position=xl320.goal_position,
    position_limits=(xl320.cw_angle_limit, xl320.ccw_angle_limit),
    max_torque=xl320.max_torque,
    torque_limit=xl320.torque_limit,
    full_torque=xl320.FULL_TORQUE,
    config_error=_xl_config_error,
    position_p=xl320.p_gain,
    hardware_error=(xl320.hardware_error_status, partial(bit_names, names=xl320.HARDWARE_ERROR_BITS)),
)


SERIES: Final = tuple(series for series in list(globals().values()) if isinstance(series, Series))
