"""Control table and models of the Feetech SCS series (potentiometer).

Sources: Feetech's "SCSCL memory table" and the SCSCL header of its SDK. docs/servos.md describes how each line was
checked. Words are big endian, and negative numbers are sign-magnitude. The series does not support sync reads.
Positions range from 0 to 1023 over the angle of the sensor, which is less than a turn. The control table has no
registers for a homing offset, an operating mode, current or a torque limit in RAM.
"""

from typing import Final

from drivers.servos.register import Access, Register, ServoModel, between, by_address
from drivers.servos.sts import KG_CM, RPM

READ: Final = Access.READ
BYTE: Final = between(0, 254)
TEN_BITS: Final = between(0, 1023)
SWITCH: Final = between(0, 1)
PER_MILLE: Final = between(0, 1000)

# EEPROM: values written while the lock is closed are lost at power-off.
firmware_major = Register("firmware_major", 0, 1, READ, persistent=True)
firmware_minor = Register("firmware_minor", 1, 1, READ, persistent=True)
model_number = Register("model_number", 3, 2, READ, persistent=True)
servo_id = Register("id", 5, 1, persistent=True, values=between(0, 253))
baud_rate = Register("baud_rate", 6, 1, persistent=True, values=between(0, 7))  # index into sts.BAUD_RATES
return_delay = Register("return_delay", 7, 1, persistent=True, values=BYTE)  # 2 us
status_level = Register("status_level", 8, 1, persistent=True, values=SWITCH)
min_position = Register("min_position", 9, 2, persistent=True, values=TEN_BITS)  # counts; 0 and 0: motor mode
max_position = Register("max_position", 11, 2, persistent=True, values=TEN_BITS)  # counts
max_temperature = Register("max_temperature", 13, 1, persistent=True, values=between(0, 100))  # deg C
max_voltage = Register("max_voltage", 14, 1, persistent=True, values=BYTE)  # 0.1 V
min_voltage = Register("min_voltage", 15, 1, persistent=True, values=BYTE)  # 0.1 V
max_torque = Register("max_torque", 16, 2, persistent=True, values=PER_MILLE)  # 0.1 %
phase = Register("phase", 18, 1, persistent=True, values=BYTE)
unloading_condition = Register("unloading_condition", 19, 1, persistent=True, values=BYTE)  # status bits
led_alarm_condition = Register("led_alarm_condition", 20, 1, persistent=True, values=BYTE)  # status bits
position_p = Register("position_p", 21, 1, persistent=True, values=BYTE)
position_d = Register("position_d", 22, 1, persistent=True, values=BYTE)
position_i = Register("position_i", 23, 1, persistent=True, values=BYTE)
minimum_startup_force = Register("minimum_startup_force", 24, 2, persistent=True, values=PER_MILLE)  # 0.1 %
cw_dead_zone = Register("cw_dead_zone", 26, 1, persistent=True, values=between(0, 32))  # counts
ccw_dead_zone = Register("ccw_dead_zone", 27, 1, persistent=True, values=between(0, 32))  # counts
protective_torque = Register("protective_torque", 37, 1, persistent=True, values=BYTE)  # %
protection_time = Register("protection_time", 38, 1, persistent=True, values=BYTE)  # 40 ms
overload_torque = Register("overload_torque", 39, 1, persistent=True, values=BYTE)  # %

# RAM: goals.
torque_enable = Register("torque_enable", 40, 1, values=between(0, 2))  # 0 off, 1 on, 2 damping
acceleration = Register("acceleration", 41, 1, values=between(0, 254))  # not in Feetech's SDK: not every servo has it
goal_position = Register("goal_position", 42, 2, values=TEN_BITS)  # counts
goal_time = Register("goal_time", 44, 2, sign_bit=15)  # ms; in motor mode the drive, with the sign in bit 10
goal_velocity = Register("goal_velocity", 46, 2)  # counts/s; 0: maximum speed
lock = Register("lock", 48, 1, values=SWITCH)  # 1: EEPROM locked

# RAM: state. The first five registers are one block of eight bytes.
present_position = Register("present_position", 56, 2, READ)  # counts
present_velocity = Register("present_velocity", 58, 2, READ, sign_bit=15)  # counts/s
present_load = Register("present_load", 60, 2, READ, sign_bit=10)  # 0.1 % of full drive
present_voltage = Register("present_voltage", 62, 1, READ)  # 0.1 V
present_temperature = Register("present_temperature", 63, 1, READ)  # deg C
async_write_flag = Register("async_write_flag", 64, 1, READ)
status = Register("status", 65, 1, READ)  # status bits
moving = Register("moving", 66, 1, READ)

# Factory values.
pwm_max_step = Register("pwm_max_step", 78, 1, READ)
moving_threshold = Register("moving_threshold", 79, 1, READ)  # 50 counts/s
dts = Register("dts", 80, 1, READ)  # ms
min_velocity = Register("min_velocity", 81, 1, READ)  # 50 counts/s
max_velocity = Register("max_velocity", 82, 1, READ)  # 50 counts/s

REGISTERS: Final = by_address(globals().values())

STATE_BLOCK: Final = (present_position, present_velocity, present_load, present_voltage, present_temperature)
GOAL_BLOCK: Final = (goal_position, goal_time, goal_velocity)

POSITIONS: Final = 1024
"""Number of positions, regardless of the angle that they span."""


def counts_per_turn(span_deg: float) -> int:
    """Return the number of counts in a full turn if the sensor covers ``span_deg``. Rounding introduces an error of
    less than half a count."""
    return round(POSITIONS * 360.0 / span_deg)


# Arguments: name, number (bytes in wire order), byte order, counts per turn, rated voltage (V), stall torque (N m),
# no-load speed (rad/s), positions.
SCS15 = ServoModel("scs15", 0x050F, "big", counts_per_turn(215.0), 7.4, 16.5 * KG_CM, 65.0 * RPM, POSITIONS)
SCS0009 = ServoModel("scs0009", 0x0504, "big", counts_per_turn(300.0), 6.0, 2.3 * KG_CM, 100.0 * RPM, POSITIONS)

MODELS: Final = {model.name: model for model in list(globals().values()) if isinstance(model, ServoModel)}
