"""Control table and models of the Feetech STS series.

Sources: Feetech's "SMS/STS memory table" (magnetic encoder) and the datasheets named next to the models. If editions of
the table differ, the newer one is used. docs/servos.md describes how each line was checked. Words are little endian.
Negative numbers are sign-magnitude, with the sign in bit 15 unless noted otherwise.
"""

import math
from typing import Final

from drivers.servos.register import Access, Register, ServoModel, between, bit_names, by_address, one_of

READ: Final = Access.READ
MODES: Final = between(0, 3)
FACTORS: Final = between(1, 128)
BYTE: Final = between(0, 254)
SWITCH: Final = between(0, 1)
PER_MILLE: Final = between(0, 1000)

# EEPROM: writable only while the lock is open.
firmware_major = Register("firmware_major", 0, 1, READ, persistent=True)
firmware_minor = Register("firmware_minor", 1, 1, READ, persistent=True)
endianness = Register("endianness", 2, 1, READ, persistent=True)  # 0: low byte first
model_number = Register("model_number", 3, 2, READ, persistent=True)  # the same in every Feetech table
servo_id = Register("id", 5, 1, persistent=True, values=between(0, 253))
baud_rate = Register("baud_rate", 6, 1, persistent=True, values=between(0, 7))  # index into BAUD_RATES
return_delay = Register("return_delay", 7, 1, persistent=True, values=BYTE)  # 2 us; 1 to 49 are treated as 50
status_level = Register("status_level", 8, 1, persistent=True, values=SWITCH)
min_position = Register("min_position", 9, 2, persistent=True)  # counts; 0 and 0: multi-turn
max_position = Register("max_position", 11, 2, persistent=True)  # counts
max_temperature = Register("max_temperature", 13, 1, persistent=True, values=between(0, 100))  # deg C
max_voltage = Register("max_voltage", 14, 1, persistent=True, values=BYTE)  # 0.1 V
min_voltage = Register("min_voltage", 15, 1, persistent=True, values=BYTE)  # 0.1 V
max_torque = Register("max_torque", 16, 2, persistent=True, values=PER_MILLE)  # 0.1 %
phase = Register("phase", 18, 1, persistent=True, values=BYTE)  # bits: direction, units, multi-turn
unloading_condition = Register("unloading_condition", 19, 1, persistent=True, values=BYTE)  # status bits
led_alarm_condition = Register("led_alarm_condition", 20, 1, persistent=True, values=BYTE)  # status bits
position_p = Register("position_p", 21, 1, persistent=True, values=BYTE)
position_d = Register("position_d", 22, 1, persistent=True, values=BYTE)
position_i = Register("position_i", 23, 1, persistent=True, values=BYTE)
# In older editions of the table, register 24 has two bytes. Both interpretations agree for values up to 254. Write to
# register 25 only if the firmware is known to have this limit.
minimum_startup_force = Register("minimum_startup_force", 24, 1, persistent=True, values=BYTE)  # 0.1 %
integral_limit = Register("integral_limit", 25, 1, persistent=True, values=BYTE)  # 4 units of I; 0: none
cw_dead_zone = Register("cw_dead_zone", 26, 1, persistent=True, values=between(0, 32))  # counts
ccw_dead_zone = Register("ccw_dead_zone", 27, 1, persistent=True, values=between(0, 32))  # counts
protection_current = Register("protection_current", 28, 2, persistent=True, values=between(0, 1023))  # 6.5 mA
angular_resolution = Register("angular_resolution", 30, 1, persistent=True, values=FACTORS)  # of goals; 0 means 1
homing_offset = Register("homing_offset", 31, 2, persistent=True, sign_bit=11)  # counts
operating_mode = Register("operating_mode", 33, 1, persistent=True, values=MODES)  # 0 position, 1 speed, 2 PWM, 3 step
protective_torque = Register("protective_torque", 34, 1, persistent=True, values=BYTE)  # %
protection_time = Register("protection_time", 35, 1, persistent=True, values=BYTE)  # 10 ms
overload_torque = Register("overload_torque", 36, 1, persistent=True, values=BYTE)  # %
velocity_p = Register("velocity_p", 37, 1, persistent=True, values=BYTE)
overcurrent_time = Register("overcurrent_time", 38, 1, persistent=True, values=BYTE)  # 10 ms
velocity_i = Register("velocity_i", 39, 1, persistent=True, values=BYTE)

# RAM: goals.
torque_enable = Register("torque_enable", 40, 1, values=one_of(0, 1, 2, 128))  # 0 off, 1 on, 2 damping, 128: set middle
acceleration = Register("acceleration", 41, 1, values=BYTE)  # 100 counts/s^2; 0: no limit
goal_position = Register("goal_position", 42, 2, sign_bit=15)  # counts
# The name is from the SCS table. On an STS, the value is the PWM goal in mode 2, and is ignored in position mode.
goal_time = Register("goal_time", 44, 2, sign_bit=10)  # 0.1 % of full drive
goal_velocity = Register("goal_velocity", 46, 2, sign_bit=15)  # counts/s; 0: maximum speed
torque_limit = Register("torque_limit", 48, 2, values=PER_MILLE)  # 0.1 %
lock = Register("lock", 55, 1, values=SWITCH)  # 1: EEPROM locked

# RAM: state. The first five registers are one block of eight bytes.
present_position = Register("present_position", 56, 2, READ, sign_bit=15)  # counts
present_velocity = Register("present_velocity", 58, 2, READ, sign_bit=15)  # counts/s
present_load = Register("present_load", 60, 2, READ, sign_bit=10)  # 0.1 % of full drive
present_voltage = Register("present_voltage", 62, 1, READ)  # 0.1 V
present_temperature = Register("present_temperature", 63, 1, READ)  # deg C
async_write_flag = Register("async_write_flag", 64, 1, READ)
status = Register("status", 65, 1, READ)  # status bits
moving = Register("moving", 66, 1, READ)
present_target = Register("present_target", 67, 2, READ, sign_bit=15)  # counts; newer firmware
present_current = Register("present_current", 69, 2, READ, sign_bit=15)  # 6.5 mA

# Factory values. Feetech describes them as read-only, but the firmware accepts and keeps new values. LeRobot writes 85.
moving_threshold = Register("moving_threshold", 80, 1, persistent=True)
dts = Register("dts", 81, 1, persistent=True)  # ms
velocity_unit = Register("velocity_unit", 82, 1, persistent=True)
hts = Register("hts", 83, 1, persistent=True)  # 20.83 ns
max_velocity = Register("max_velocity", 84, 1, persistent=True)  # 0.732 rpm
max_acceleration = Register("max_acceleration", 85, 1, persistent=True)  # 100 counts/s^2
acceleration_multiplier = Register("acceleration_multiplier", 86, 1, persistent=True)  # used if acceleration is 0

REGISTERS: Final = by_address(globals().values())

STATE_BLOCK: Final = (present_position, present_velocity, present_load, present_voltage, present_temperature)
GOAL_BLOCK: Final = (acceleration, goal_position, goal_time, goal_velocity)

COUNTS_PER_S_PHASE: Final = 1 << 2
"""Bit in ``phase`` that selects counts/s as the unit of speed instead of 50 counts/s."""
POSITION_LIMITS: Final = (min_position, max_position)

BAUD_RATES: Final = (1_000_000, 500_000, 250_000, 128_000, 115_200, 76_800, 57_600, 38_400)

STATUS_BITS: Final = {0: "voltage", 1: "angle sensor", 2: "temperature", 3: "current", 4: "angle", 5: "overload"}
"""Meaning of the bits of a reply's status byte and of the ``status`` register."""

VOLTAGE_UNIT_V: Final = 0.1
TORQUE_UNIT: Final = 0.001
ACCELERATION_UNIT_COUNTS_S2: Final = 100
GOAL_ACCELERATION: Final = (
    100  # sent with every goal; 0 means the product of registers 85 and 86, which differs between servos
)
CURRENT_UNIT_A: Final = 0.0065

KG_CM: Final = 0.0980665  # factor from kg cm, the unit in the datasheets, to N m
RPM: Final = 2.0 * math.pi / 60.0  # factor from rpm to rad/s
DEG: Final = math.pi / 180.0

# Arguments: name, number, byte order, counts per turn, rated voltage (V), stall torque (N m), no-load speed (rad/s).
STS3215 = ServoModel("sts3215", 777, "little", 4096, 12.0, 2.94, 45.0 * RPM)  # C018, gear 1:345; 30 kg cm
STS3215_C001 = ServoModel("sts3215_c001", 777, "little", 4096, 7.4, 19.5 * KG_CM, 52.0 * RPM)  # gear 1:345
# Vendors disagree about these models. The values are those of the same motor, converted by the gear ratio.
STS3215_C044 = ServoModel("sts3215_c044", 777, "little", 4096, 7.4, 19.5 * KG_CM * 191 / 345, 52.0 * RPM * 345 / 191)
STS3215_C046 = ServoModel("sts3215_c046", 777, "little", 4096, 7.4, 19.5 * KG_CM * 147 / 345, 52.0 * RPM * 345 / 147)
STS3250 = ServoModel("sts3250", 2825, "little", 4096, 12.0, 50.0 * KG_CM, 60.0 * DEG / 0.133)  # C001
# Some tools report 2313 for this servo, but Feetech's own debug tool lists this number for the STS3095.
STS3250_2313 = ServoModel("sts3250_2313", 2313, "little", 4096, 12.0, 50.0 * KG_CM, 60.0 * DEG / 0.133)
STS3235 = ServoModel("sts3235", 2057, "little", 4096, 12.0, 30.0 * KG_CM, 45.0 * RPM)
# The SM series uses the same control table. The speed is assumed.
SM8512BL = ServoModel("sm8512bl", 11272, "little", 4096, 12.0, 85.0 * KG_CM, 50.0 * RPM)
STS3032 = ServoModel("sts3032", 521, "little", 4096, 12.0, 10.0 * KG_CM, 148.0 * RPM)  # C062

MODELS: Final = {model.name: model for model in list(globals().values()) if isinstance(model, ServoModel)}


def alarms(status: int) -> tuple[str, ...]:
    return bit_names(status, STATUS_BITS)
