"""Control table and models of the Dynamixel X series, and of the MX-28 with protocol 2.0 firmware.

Source: ROBOTIS e-manual, pages of the models. Numbers, addresses and sizes agree with the model files in the official
SDK (dynamixel_easy_sdk 4.1, control_table). docs/servos.md lists the sources against which each line was checked. The
models' tables differ only in the registers after ``REGISTERS``, in the values that some registers accept, and in the
addresses of the indirect registers. Numbers are little endian, and negative numbers are two's complement.

A servo rejects unsupported values with error 4. Goals are also limited by other registers, such as the position limits.
A servo rejects a goal beyond these limits with error 6.
"""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from drivers.servos.register import (
    Access,
    Datasheet,
    Register,
    ServoModel,
    between,
    bit_names,
    by_address,
    merged,
    one_of,
)

READ: Final = Access.READ
LEVELS: Final = between(0, 2)
SWITCH: Final = between(0, 1)
GAIN: Final = between(0, 16383)
PROFILE: Final = between(0, 32767)
LARGEST_HOMING_OFFSET: Final = 1_044_479
LARGEST_EXTENDED_POSITION: Final = 1_048_575
OFFSETS: Final = between(-LARGEST_HOMING_OFFSET, LARGEST_HOMING_OFFSET)
EXTENDED: Final = between(-LARGEST_EXTENDED_POSITION, LARGEST_EXTENDED_POSITION)

# EEPROM: writable only while torque is disabled.
model_number = Register("model_number", 0, 2, READ, persistent=True)
model_information = Register("model_information", 2, 4, READ, persistent=True)
firmware_version = Register("firmware_version", 6, 1, READ, persistent=True)
servo_id = Register("id", 7, 1, persistent=True, values=between(0, 252))
baud_rate = Register("baud_rate", 8, 1, persistent=True, values=between(0, 7))  # index into BAUD_RATES
return_delay = Register("return_delay", 9, 1, persistent=True, values=between(0, 254))  # 2 us
drive_mode = Register("drive_mode", 10, 1, persistent=True, values=between(0, 13))  # bits, see below
operating_mode = Register("operating_mode", 11, 1, persistent=True, values=one_of(1, 3, 4, 16))  # 3: position
secondary_id = Register("secondary_id", 12, 1, persistent=True)  # above 252: none
protocol_type = Register("protocol_type", 13, 1, persistent=True, values=one_of(1, 2))
homing_offset = Register("homing_offset", 20, 4, persistent=True, signed=True, values=OFFSETS)  # counts
moving_threshold = Register("moving_threshold", 24, 4, persistent=True, values=between(0, 1023))  # 0.229 rpm
temperature_limit = Register("temperature_limit", 31, 1, persistent=True, values=between(0, 100))  # deg C
max_voltage_limit = Register("max_voltage_limit", 32, 2, persistent=True)  # 0.1 V
min_voltage_limit = Register("min_voltage_limit", 34, 2, persistent=True)  # 0.1 V
pwm_limit = Register("pwm_limit", 36, 2, persistent=True, values=between(0, 885))  # 1/885 of full drive
velocity_limit = Register("velocity_limit", 44, 4, persistent=True, values=between(0, 1023))  # 0.229 rpm
max_position_limit = Register("max_position_limit", 48, 4, persistent=True, values=between(0, 4095))  # counts
min_position_limit = Register("min_position_limit", 52, 4, persistent=True, values=between(0, 4095))  # counts
shutdown = Register("shutdown", 63, 1, persistent=True)  # hardware error bits

# RAM: switches, gains and goals.
torque_enable = Register("torque_enable", 64, 1, values=SWITCH)  # 0 off, 1 on
status_return_level = Register("status_return_level", 68, 1, values=LEVELS)  # 0: ping, 1: ping and read, 2: all
registered_instruction = Register("registered_instruction", 69, 1, READ)
hardware_error_status = Register("hardware_error_status", 70, 1, READ)  # hardware error bits
velocity_i_gain = Register("velocity_i_gain", 76, 2, values=GAIN)
velocity_p_gain = Register("velocity_p_gain", 78, 2, values=GAIN)
position_d_gain = Register("position_d_gain", 80, 2, values=GAIN)  # 1/16
position_i_gain = Register("position_i_gain", 82, 2, values=GAIN)  # 1/65536
position_p_gain = Register("position_p_gain", 84, 2, values=GAIN)  # 1/128
feedforward_2nd_gain = Register("feedforward_2nd_gain", 88, 2, values=GAIN)  # 1/4
feedforward_1st_gain = Register("feedforward_1st_gain", 90, 2, values=GAIN)  # 1/4
bus_watchdog = Register("bus_watchdog", 98, 1, values=between(0, 127))  # 20 ms
goal_pwm = Register("goal_pwm", 100, 2, signed=True)  # 1/885; in position mode the PWM limit
goal_velocity = Register("goal_velocity", 104, 4, signed=True)  # 0.229 rpm
profile_acceleration = Register("profile_acceleration", 108, 4, values=PROFILE)  # 214.577 rev/min^2; 0: no ramp
profile_velocity = Register("profile_velocity", 112, 4, values=PROFILE)  # 0.229 rpm; 0: maximum speed
goal_position = Register("goal_position", 116, 4, signed=True, values=EXTENDED)  # counts

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

# Not all models have these registers.
led = Register("led", 65, 1, values=SWITCH)  # not in XW540 and XW430
external_port_mode_1 = Register("external_port_mode_1", 56, 1, persistent=True, values=between(0, 3))  # X540
external_port_mode_2 = Register("external_port_mode_2", 57, 1, persistent=True, values=between(0, 3))
external_port_mode_3 = Register("external_port_mode_3", 58, 1, persistent=True, values=between(0, 3))
external_port_data_1 = Register("external_port_data_1", 152, 2)
external_port_data_2 = Register("external_port_data_2", 154, 2)
external_port_data_3 = Register("external_port_data_3", 156, 2)
# Some models estimate their load, and the others measure their current.
present_load = Register("present_load", 126, 2, READ, signed=True)  # 0.1 %
present_current = Register("present_current", 126, 2, READ, signed=True)  # the model's unit
current_limit = Register("current_limit", 38, 2, persistent=True)  # the model's unit
goal_current = Register("goal_current", 102, 2, signed=True)  # the model's unit
pwm_slope = Register("pwm_slope", 62, 1, persistent=True, values=between(1, 255))  # XL330, XC330
acceleration_limit = Register("acceleration_limit", 40, 4, persistent=True, values=PROFILE)  # MX-28; 214.577 rev/min^2

# MX servos, and firmware versions before 45 (X330: 46), lack these two registers.
startup_configuration = Register(
    "startup_configuration", 60, 1, persistent=True, values=between(0, 3)
)  # bits, see below
backup_ready = Register("backup_ready", 147, 1, READ)  # 1: there is a backup of the control table

STATE_BLOCK_END: Final = present_temperature.address + present_temperature.size
"""End of the state block, which is the same in all models. The load is present_pwm, because register 126 differs."""
GOAL_BLOCK: Final = (profile_velocity, goal_position)

BAUD_RATES: Final = (9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""Baud rates by the value of ``baud_rate``. XL330 and XC330 do not support the last rate."""

POSITION_MODE: Final = 3
EXTENDED_POSITION_MODE: Final = 4
CURRENT_POSITION_MODE: Final = 5
"""Extended position mode with ``goal_current`` as the current limit. Only models that measure current have this mode.
"""
MODES_WITH_TURNS: Final = (EXTENDED_POSITION_MODE, CURRENT_POSITION_MODE)
"""Modes in which goals and positions span several turns and position limits are ignored."""
LARGEST_OFFSET_OF_POSITION_MODE: Final = 1024
"""Maximum homing offset in position mode. The servo ignores a larger offset completely."""
STARTUP_TORQUE_ON: Final = 1 << 0
"""Bit in ``startup_configuration`` that enables torque at power-on."""
STARTUP_RESTORE: Final = 1 << 1
"""Bit in ``startup_configuration`` that restores gains from the backup at power-on."""
REVERSE: Final = 1 << 0
"""Bit in ``drive_mode`` that inverts the direction of positions, velocities and drive."""
TIME_BASED_PROFILE: Final = 1 << 2
"""Bit in ``drive_mode`` that makes profile_velocity a time in ms."""
TORQUE_ON_BY_GOAL: Final = 1 << 3
"""Bit in ``drive_mode`` that makes every goal enable torque."""

HARDWARE_ERROR_BITS: Final = {0: "voltage", 2: "temperature", 3: "motor encoder", 4: "electrical shock", 5: "overload"}

FULL_PWM: Final = 885
COUNTS_PER_TURN: Final = 4096
VELOCITY_UNIT_COUNTS_S: Final = 0.229 * COUNTS_PER_TURN / 60.0
ACCELERATION_UNIT_COUNTS_S2: Final = 214.577 * COUNTS_PER_TURN / 3600.0
VOLTAGE_UNIT_V: Final = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class XModel(ServoModel):
    """A servo model.

    ``own`` holds the registers that are not in ``REGISTERS``. The stall current is valid at rated voltage.
    """

    current_unit_a: float | None
    """Unit of ``present_current``, in A. None if the model has ``present_load`` instead."""
    stall_current_a: float
    short_map: bool = False
    """Whether the model has fewer indirect registers, whose addresses differ in old firmware."""


class Family(NamedTuple):
    """Properties that models of the same size share."""

    voltage_limits: tuple[int, int]
    """Lowest and highest values of both voltage limits, in 0.1 V."""
    current_unit_a: float | None = None
    own: tuple[Register, ...] = ()
    """Registers that not all families have, or that accept different values in this family."""
    short_map: bool = False


_PORTS: Final = (
    external_port_mode_1,
    external_port_mode_2,
    external_port_mode_3,
    external_port_data_1,
    external_port_data_2,
    external_port_data_3,
)
_DUAL: Final = replace(drive_mode, values=between(0, 15))
"""Drive mode of models that can be coupled in pairs by a cable. Bit 1 makes a servo the follower."""
_X330_OWN: Final = (
    led,
    pwm_slope,
    replace(baud_rate, values=between(0, 6)),
    replace(protocol_type, values=one_of(2, 20, 21, 22)),
    replace(velocity_limit, values=between(0, 2047)),
)
X330_5V: Final = Family((31, 70), 0.001, _X330_OWN, short_map=True)
X330_12V: Final = Family((55, 140), 0.001, _X330_OWN, short_map=True)
X335: Final = Family((55, 140), 0.001, _X330_OWN)
XL430: Final = Family((60, 140), own=(led,))
XC430: Final = Family((60, 160), own=(led,))
X430: Final = Family((95, 160), 0.00269, (led,))
X430_24V: Final = Family((110, 300), 0.00134, (led,))
X540: Final = Family((95, 160), 0.00269, (led, *_PORTS, _DUAL))
X540_24V: Final = Family((110, 300), 0.00269, (led, *_PORTS, _DUAL))
XW: Final = Family((95, 160), 0.00269)
XW_24V: Final = Family((110, 300), 0.00269)
MX_28: Final = Family((95, 160), own=(led, acceleration_limit))
MX: Final = Family((95, 160), 0.00336, (led, acceleration_limit))
MX_DUAL: Final = Family((95, 160), 0.00336, (led, acceleration_limit, _DUAL))


def _model(name: str, number: int, sheet: Datasheet, family: Family, largest_current: int = 0) -> XModel:
    """Create a model. ``largest_current`` is the maximum current limit, in the family's unit."""
    voltages = between(*family.voltage_limits)
    limits = (replace(max_voltage_limit, values=voltages), replace(min_voltage_limit, values=voltages))
    backup = () if acceleration_limit in family.own else (startup_configuration, backup_ready)  # an MX has neither
    return XModel(
        name, number, "little", COUNTS_PER_TURN,
        sheet.rated_voltage_v, sheet.stall_torque_nm, sheet.no_load_speed_rad_s,
        own=(*_current_registers(family, largest_current), *limits, *family.own, *backup),
        current_unit_a=family.current_unit_a,
        stall_current_a=sheet.stall_current_a,
        short_map=family.short_map,
    )  # fmt: skip


def _current_registers(family: Family, largest: int) -> tuple[Register, ...]:
    """Return the registers that depend on whether a family measures its current."""
    if family.current_unit_a is None:
        return (present_load,)
    modes = replace(operating_mode, values=one_of(0, 1, 3, 4, 5, 16))
    return modes, replace(current_limit, values=between(0, largest)), goal_current, present_current


XL330_M077 = _model("xl330-m077", 1190, Datasheet(5.0, 0.215, 1.47, 383.0), X330_5V, 1750)
XL330_M288 = _model("xl330-m288", 1200, Datasheet(5.0, 0.52, 1.47, 103.0), X330_5V, 1750)
XC330_M181 = _model("xc330-m181", 1230, Datasheet(5.0, 0.60, 1.8, 129.0), X330_5V, 2352)
XC330_M288 = _model("xc330-m288", 1240, Datasheet(5.0, 0.93, 1.8, 81.0), X330_5V, 2352)
XC330_T181 = _model("xc330-t181", 1210, Datasheet(12.0, 0.80, 0.88, 113.0), X330_12V, 910)
XC330_T288 = _model("xc330-t288", 1220, Datasheet(12.0, 1.0, 0.88, 71.0), X330_12V, 910)
XL430_W250 = _model("xl430-w250", 1060, Datasheet(12.0, 1.5, 1.4, 61.0), XL430)
XC430_W150 = _model("xc430-w150", 1070, Datasheet(12.0, 1.6, 1.4, 106.0), XC430)
XC430_W240 = _model("xc430-w240", 1080, Datasheet(12.0, 1.9, 1.4, 70.0), XC430)
XM430_W210 = _model("xm430-w210", 1030, Datasheet(12.0, 3.0, 2.3, 77.0), X430, 1193)
XM430_W350 = _model("xm430-w350", 1020, Datasheet(12.0, 4.1, 2.3, 46.0), X430, 1193)
XH430_W210 = _model("xh430-w210", 1010, Datasheet(12.0, 2.5, 1.3, 50.0), X430, 648)
XH430_W350 = _model("xh430-w350", 1000, Datasheet(12.0, 3.4, 1.3, 30.0), X430, 648)
XH430_V210 = _model("xh430-v210", 1050, Datasheet(24.0, 2.6, 0.7, 52.0), X430_24V, 689)
XH430_V350 = _model("xh430-v350", 1040, Datasheet(24.0, 3.3, 0.7, 31.0), X430_24V, 689)
XD430_T210 = _model("xd430-t210", 1011, Datasheet(12.0, 2.5, 1.3, 50.0), X430, 648)
XD430_T350 = _model("xd430-t350", 1001, Datasheet(12.0, 3.4, 1.3, 30.0), X430, 648)
XM540_W150 = _model("xm540-w150", 1130, Datasheet(12.0, 7.3, 4.4, 53.0), X540, 2047)
XM540_W270 = _model("xm540-w270", 1120, Datasheet(12.0, 10.6, 4.4, 30.0), X540, 2047)
XH540_W150 = _model("xh540-w150", 1110, Datasheet(12.0, 7.1, 4.9, 70.0), X540, 2047)
XH540_W270 = _model("xh540-w270", 1100, Datasheet(12.0, 9.9, 4.9, 39.0), X540, 2047)
XH540_V150 = _model("xh540-v150", 1150, Datasheet(24.0, 6.4, 2.4, 60.0), X540_24V, 1188)
XH540_V270 = _model("xh540-v270", 1140, Datasheet(24.0, 9.2, 2.4, 34.0), X540_24V, 1188)
XD540_T150 = _model("xd540-t150", 1111, Datasheet(12.0, 7.1, 4.9, 70.0), X540, 2047)
XD540_T270 = _model("xd540-t270", 1101, Datasheet(12.0, 9.9, 4.9, 39.0), X540, 2047)
XW540_T140 = _model("xw540-t140", 1180, Datasheet(12.0, 6.9, 4.9, 72.0), XW, 2047)
XW540_T260 = _model("xw540-t260", 1170, Datasheet(12.0, 9.5, 4.9, 40.0), XW, 2047)
# The values of these two models are those of the XH540-V270 and the XH430-W350, converted by the gear ratio (assumed).
XW540_H260 = _model("xw540-h260", 1310, Datasheet(24.0, 8.8, 2.4, 35.6), XW_24V, 1188)
XW430_T333 = _model("xw430-t333", 1270, Datasheet(12.0, 3.2, 1.3, 31.8), XW, 2047)
TWO_XL430_W250 = _model("2xl430-w250", 1090, Datasheet(12.0, 1.5, 1.4, 61.0), XL430)
TWO_XC430_W250 = _model("2xc430-w250", 1160, Datasheet(12.0, 1.8, 1.4, 64.0), XC430)
# The values are those of the XC330-T288, because the datasheet is not published.
XC335_T332 = _model("xc335-t332", 1700, Datasheet(12.0, 1.0, 0.88, 71.0), X335, 910)
MX_28_2 = _model("mx-28-2.0", 30, Datasheet(12.0, 2.5, 1.4, 55.0), MX_28)
"""MX-28 with protocol 2.0 firmware. With protocol 1.0 firmware, its model number is 29 (``ax_mx``)."""

MX_64_2 = _model("mx-64-2.0", 311, Datasheet(12.0, 6.0, 4.1, 63.0), MX, 1941)
MX_106_2 = _model("mx-106-2.0", 321, Datasheet(12.0, 8.4, 5.2, 45.0), MX_DUAL, 2047)

MODELS: Final = {model.name: model for model in list(globals().values()) if isinstance(model, XModel)}
PAIRS: Final = (TWO_XL430_W250, TWO_XC430_W250)
"""Models that combine two servos in one case. Each servo has its own ID."""


def needs_extended_position(homing_offset: int) -> bool:
    """Return whether this homing offset takes effect only in the multi-turn modes.

    Position mode ignores such an offset.
    """
    return abs(homing_offset) > LARGEST_OFFSET_OF_POSITION_MODE


def within_turn(counts: int, homing_offset: int) -> int:
    """Return the position that a servo in position mode reports instead of ``counts`` once its torque is enabled."""
    added = 0 if needs_extended_position(homing_offset) else homing_offset
    return (counts - added) % COUNTS_PER_TURN + added


def current_unit_a(model: ServoModel) -> float | None:
    """Return the unit of ``present_current``, in A. None if the model does not measure its current."""
    return model.current_unit_a if isinstance(model, XModel) else None


def has_short_map(model: ServoModel) -> bool:
    """Return whether a model has fewer indirect registers, whose addresses differ in old firmware."""
    return isinstance(model, XModel) and model.short_map


def registers(model: ServoModel) -> tuple[Register, ...]:
    """Return the control table of a model without indirect registers, sorted by address."""
    return merged(REGISTERS, model.own)


def alarms(hardware_error: int) -> tuple[str, ...]:
    return bit_names(hardware_error, HARDWARE_ERROR_BITS)
