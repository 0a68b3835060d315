"""Control table of the Dynamixel XL-320, which uses protocol 2.0 but differs from the X series.

Source: ROBOTIS e-manual, page XL-320. All addresses and sizes agree with xl320.model of the official SDK
(dynamixel_easy_sdk 4.1). Numbers are little endian. Bit 10 of a speed or load is the direction: 1 is clockwise, toward
smaller positions.
"""

import math
from typing import Final

from drivers.servos.register import Access, Register, ServoModel, between, by_address, one_of

READ: Final = Access.READ
LEVELS: Final = between(0, 2)
BYTE: Final = between(0, 254)
TEN_BITS: Final = between(0, 1023)

# EEPROM.
model_number = Register("model_number", 0, 2, READ, persistent=True)
firmware_version = Register("firmware_version", 2, 1, READ, persistent=True)
servo_id = Register("id", 3, 1, persistent=True, values=between(0, 252))
baud_rate = Register("baud_rate", 4, 1, persistent=True, values=between(0, 3))  # index into BAUD_RATES
return_delay = Register("return_delay", 5, 1, persistent=True, values=BYTE)  # 2 us
cw_angle_limit = Register("cw_angle_limit", 6, 2, persistent=True, values=TEN_BITS)  # counts
ccw_angle_limit = Register("ccw_angle_limit", 8, 2, persistent=True, values=TEN_BITS)  # counts
control_mode = Register("control_mode", 11, 1, persistent=True, values=one_of(1, 2))  # 1: wheel, 2: joint
temperature_limit = Register("temperature_limit", 12, 1, persistent=True, values=between(0, 150))  # deg C
min_voltage_limit = Register("min_voltage_limit", 13, 1, persistent=True, values=between(50, 250))  # 0.1 V
max_voltage_limit = Register("max_voltage_limit", 14, 1, persistent=True, values=between(50, 250))  # 0.1 V
max_torque = Register("max_torque", 15, 2, persistent=True, values=TEN_BITS)  # 1/1023
status_return_level = Register("status_return_level", 17, 1, persistent=True, values=LEVELS)  # 1: ping and read, 2: all
shutdown = Register("shutdown", 18, 1, persistent=True, values=between(0, 7))  # hardware error bits

# RAM: switches, gains and goals.
torque_enable = Register("torque_enable", 24, 1, values=between(0, 1))  # 0 off, 1 on
led = Register("led", 25, 1, values=between(0, 7))
d_gain = Register("d_gain", 27, 1, values=BYTE)
i_gain = Register("i_gain", 28, 1, values=BYTE)
p_gain = Register("p_gain", 29, 1, values=BYTE)
goal_position = Register("goal_position", 30, 2)  # counts
moving_speed = Register("moving_speed", 32, 2, values=between(0, 2047))  # 0.111 rpm; 0: maximum speed
torque_limit = Register("torque_limit", 35, 2, values=TEN_BITS)  # 1/1023; 0 after a shutdown

# RAM: state.
present_position = Register("present_position", 37, 2, READ)  # counts
present_speed = Register("present_speed", 39, 2, READ, sign_bit=10)  # 0.111 rpm
present_load = Register("present_load", 41, 2, READ, sign_bit=10)  # 1/1023 of full drive, estimated
present_voltage = Register("present_voltage", 45, 1, READ)  # 0.1 V
present_temperature = Register("present_temperature", 46, 1, READ)  # deg C
registered_instruction = Register("registered_instruction", 47, 1, READ)
moving = Register("moving", 49, 1, READ)
hardware_error_status = Register("hardware_error_status", 50, 1, READ)  # hardware error bits
punch = Register("punch", 51, 2, values=TEN_BITS)

REGISTERS: Final = by_address(globals().values())

STATE_BLOCK_END: Final = present_temperature.address + present_temperature.size
"""End of the state block. The two bytes at 43 are not documented."""
GOAL_BLOCK: Final = (goal_position, moving_speed)

BAUD_RATES: Final = (9_600, 57_600, 115_200, 1_000_000)
"""Baud rates by the value of ``baud_rate``."""

JOINT_MODE: Final = 2
HARDWARE_ERROR_BITS: Final = {0: "overload", 1: "temperature", 2: "voltage"}
"""The e-manual defines these bits only for ``shutdown``. ``hardware_error_status`` is assumed to use the same bits."""

POSITIONS: Final = 1024
"""Number of positions, over 300 degrees."""
LARGEST_SPEED: Final = 1023
FULL_TORQUE: Final = 1023
COUNTS_PER_TURN: Final = round(POSITIONS * 360.0 / 300.0)
SPEED_UNIT_COUNTS_S: Final = 0.111 * COUNTS_PER_TURN / 60.0
VOLTAGE_UNIT_V: Final = 0.1

XL320: Final = ServoModel("xl320", 350, "little", COUNTS_PER_TURN, 7.4, 0.39, 114.0 * 2.0 * math.pi / 60.0, POSITIONS)
MODELS: Final = {XL320.name: XL320}
