"""Control table and models of the Dynamixel X series, and of the MX-28 with protocol 2.0 firmware.

Source: ROBOTIS e-manual, pages of the models. Numbers, addresses and sizes agree with the model files in the official
SDK (dynamixel_easy_sdk 4.1, control_table). docs/servos.md lists the sources against which each line was checked. The
tables of the models differ only at 38, 40, 62, 102 and 126 (see below) and in the addresses of the indirect registers.
Numbers are little endian, and negative numbers are two's complement.
"""

import math
from dataclasses import dataclass
from typing import Final

from drivers.servos.register import Access, Register, ServoModel, bit_names, by_address

READ: Final = Access.READ

# EEPROM: writable only while torque is disabled.
model_number = Register("model_number", 0, 2, READ, persistent=True)
model_information = Register("model_information", 2, 4, READ, persistent=True)
firmware_version = Register("firmware_version", 6, 1, READ, persistent=True)
servo_id = Register("id", 7, 1, persistent=True)
baud_rate = Register("baud_rate", 8, 1, persistent=True)  # index into BAUD_RATES
return_delay = Register("return_delay", 9, 1, persistent=True)  # 2 us
drive_mode = Register("drive_mode", 10, 1, persistent=True)  # bits, see below
operating_mode = Register("operating_mode", 11, 1, persistent=True)  # 3: position
secondary_id = Register("secondary_id", 12, 1, persistent=True)  # above 252: none
protocol_type = Register("protocol_type", 13, 1, persistent=True)
homing_offset = Register("homing_offset", 20, 4, persistent=True, signed=True)  # counts
moving_threshold = Register("moving_threshold", 24, 4, persistent=True)  # 0.229 rpm
temperature_limit = Register("temperature_limit", 31, 1, persistent=True)  # deg C
max_voltage_limit = Register("max_voltage_limit", 32, 2, persistent=True)  # 0.1 V
min_voltage_limit = Register("min_voltage_limit", 34, 2, persistent=True)  # 0.1 V
pwm_limit = Register("pwm_limit", 36, 2, persistent=True)  # 1/885 of full drive
velocity_limit = Register("velocity_limit", 44, 4, persistent=True)  # 0.229 rpm
max_position_limit = Register("max_position_limit", 48, 4, persistent=True)  # counts
min_position_limit = Register("min_position_limit", 52, 4, persistent=True)  # counts
shutdown = Register("shutdown", 63, 1, persistent=True)  # hardware error bits

# RAM: switches, gains and goals.
torque_enable = Register("torque_enable", 64, 1)  # 0 off, 1 on
led = Register("led", 65, 1)
status_return_level = Register("status_return_level", 68, 1)  # 0: ping, 1: ping and read, 2: all
registered_instruction = Register("registered_instruction", 69, 1, READ)
hardware_error_status = Register("hardware_error_status", 70, 1, READ)  # hardware error bits
velocity_i_gain = Register("velocity_i_gain", 76, 2)
velocity_p_gain = Register("velocity_p_gain", 78, 2)
position_d_gain = Register("position_d_gain", 80, 2)  # 1/16
position_i_gain = Register("position_i_gain", 82, 2)  # 1/65536
position_p_gain = Register("position_p_gain", 84, 2)  # 1/128
feedforward_2nd_gain = Register("feedforward_2nd_gain", 88, 2)  # 1/4
feedforward_1st_gain = Register("feedforward_1st_gain", 90, 2)  # 1/4
bus_watchdog = Register("bus_watchdog", 98, 1)  # 20 ms
goal_pwm = Register("goal_pwm", 100, 2, signed=True)  # 1/885; in position mode the PWM limit
goal_velocity = Register("goal_velocity", 104, 4, signed=True)  # 0.229 rpm
profile_acceleration = Register("profile_acceleration", 108, 4)  # 214.577 rev/min^2; 0: no ramp
profile_velocity = Register("profile_velocity", 112, 4)  # 0.229 rpm; 0: maximum speed
goal_position = Register("goal_position", 116, 4, signed=True)  # counts

# RAM: state.
realtime_tick = Register("realtime_tick", 120, 2, READ)  # ms
moving = Register("moving", 122, 1, READ)
moving_status = Register("moving_status", 123, 1, READ)
present_pwm = Register("present_pwm", 124, 2, READ, signed=True)  # 1/885 of full drive
present_velocity = Register("present_velocity", 128, 4, READ, signed=True)  # 0.229 rpm
present_position = Register("present_position", 132, 4, READ, signed=True)  # counts
velocity_trajectory = Register("velocity_trajectory", 136, 4, READ, signed=True)  # 0.229 rpm
position_trajectory = Register("position_trajectory", 140, 4, READ, signed=True)  # counts
present_voltage = Register("present_voltage", 144, 2, READ)  # 0.1 V
present_temperature = Register("present_temperature", 146, 1, READ)  # deg C

REGISTERS: Final = by_address(globals().values())
"""Registers of all models."""

# These registers are not in all models. Some models estimate their load, and the others measure their current.
present_load = Register("present_load", 126, 2, READ, signed=True)  # 0.1 %
present_current = Register("present_current", 126, 2, READ, signed=True)  # the model's unit
current_limit = Register("current_limit", 38, 2, persistent=True)  # the model's unit
goal_current = Register("goal_current", 102, 2, signed=True)  # the model's unit
pwm_slope = Register("pwm_slope", 62, 1, persistent=True)  # XL330, XC330
acceleration_limit = Register("acceleration_limit", 40, 4, persistent=True)  # MX-28; 214.577 rev/min^2

STATE_BLOCK_END: Final = present_temperature.address + present_temperature.size
"""End of the state block, which is the same in all models. The load is present_pwm, because register 126 differs."""
GOAL_BLOCK: Final = (profile_velocity, goal_position)

BAUD_RATES: Final = (9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""Baud rates by the value of ``baud_rate``. XL330 and XC330 do not support the last one."""

POSITION_MODE: Final = 3
EXTENDED_POSITION_MODE: Final = 4
"""Mode in which goals and positions count several turns and position limits are ignored."""
LARGEST_OFFSET_OF_POSITION_MODE: Final = 1024
"""Largest homing offset in position mode. A larger offset is ignored completely."""
LARGEST_HOMING_OFFSET: Final = 1_044_479
LARGEST_EXTENDED_POSITION: Final = 1_048_575
TIME_BASED_PROFILE: Final = 1 << 2
"""Bit of drive_mode that makes profile_velocity a time in ms."""
TORQUE_ON_BY_GOAL: Final = 1 << 3
"""Bit of drive_mode that makes every goal enable torque."""

HARDWARE_ERROR_BITS: Final = {0: "voltage", 2: "temperature", 3: "motor encoder", 4: "electrical shock", 5: "overload"}

FULL_PWM: Final = 885
COUNTS_PER_TURN: Final = 4096
VELOCITY_UNIT_COUNTS_S: Final = 0.229 * COUNTS_PER_TURN / 60.0
ACCELERATION_UNIT_COUNTS_S2: Final = 214.577 * COUNTS_PER_TURN / 3600.0
VOLTAGE_UNIT_V: Final = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class XModel(ServoModel):
    """A servo model. ``own`` holds its registers beyond ``REGISTERS``. The stall current is that at rated voltage."""

    own: tuple[Register, ...]
    current_unit_a: float | None
    """Unit of ``present_current``, in A. None if the model has ``present_load`` instead."""
    stall_current_a: float


def _model(
    name: str, number: int, volts: float, stall_nm: float, stall_a: float, rpm: float, unit_a: float | None,
    *own: Register,
) -> XModel:  # fmt: skip
    """Create a model. ``own`` holds registers that not all models have, except those at 38, 102 and 126."""
    own += (present_load,) if unit_a is None else (current_limit, goal_current, present_current)
    return XModel(
        name, number, "little", COUNTS_PER_TURN, volts, stall_nm, rpm * 2.0 * math.pi / 60.0,
        own=own, current_unit_a=unit_a, stall_current_a=stall_a,
    )  # fmt: skip


XL330_M077 = _model("xl330-m077", 1190, 5.0, 0.215, 1.47, 383.0, 0.001, pwm_slope)
XL330_M288 = _model("xl330-m288", 1200, 5.0, 0.52, 1.47, 103.0, 0.001, pwm_slope)
XC330_M181 = _model("xc330-m181", 1230, 5.0, 0.60, 1.8, 129.0, 0.001, pwm_slope)
XC330_M288 = _model("xc330-m288", 1240, 5.0, 0.93, 1.8, 81.0, 0.001, pwm_slope)
XC330_T181 = _model("xc330-t181", 1210, 12.0, 0.80, 0.88, 113.0, 0.001, pwm_slope)
XC330_T288 = _model("xc330-t288", 1220, 12.0, 1.0, 0.88, 71.0, 0.001, pwm_slope)
XL430_W250 = _model("xl430-w250", 1060, 12.0, 1.5, 1.4, 61.0, None)
XC430_W150 = _model("xc430-w150", 1070, 12.0, 1.6, 1.4, 106.0, None)
XC430_W240 = _model("xc430-w240", 1080, 12.0, 1.9, 1.4, 70.0, None)
XM430_W210 = _model("xm430-w210", 1030, 12.0, 3.0, 2.3, 77.0, 0.00269)
XM430_W350 = _model("xm430-w350", 1020, 12.0, 4.1, 2.3, 46.0, 0.00269)
MX_28_2 = _model("mx-28-2.0", 30, 12.0, 2.5, 1.4, 55.0, None, acceleration_limit)
"""MX-28 with protocol 2.0 firmware. With protocol 1.0 firmware, its model number is 29 (``ax_mx``)."""

MODELS: Final = {model.name: model for model in list(globals().values()) if isinstance(model, XModel)}

X330: Final = tuple(model for model in MODELS.values() if pwm_slope in model.own)
"""Models with fewer indirect registers, whose addresses differ in old firmware."""
CURRENT_UNIT_A: Final = {name: unit_a for name, model in MODELS.items() if (unit_a := model.current_unit_a) is not None}
"""Unit of ``present_current`` of each model that measures its current, in A."""


def needs_extended_position(homing_offset: int) -> bool:
    """Whether only the modes that count turns apply this homing offset. Position mode ignores it."""
    return abs(homing_offset) > LARGEST_OFFSET_OF_POSITION_MODE


def within_turn(counts: int, homing_offset: int) -> int:
    """Return the position that a servo in position mode reports instead of ``counts`` once its torque is enabled."""
    added = 0 if needs_extended_position(homing_offset) else homing_offset
    return (counts - added) % COUNTS_PER_TURN + added


def registers(model: XModel) -> tuple[Register, ...]:
    """Return the control table of a model without indirect registers, sorted by address."""
    return by_address(REGISTERS + model.own)


def alarms(hardware_error: int) -> tuple[str, ...]:
    return bit_names(hardware_error, HARDWARE_ERROR_BITS)
