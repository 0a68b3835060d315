"""Control tables and models of Dynamixel servos with protocol 1.0: AX, RX, EX and MX.

Source: ROBOTIS e-manual, the models' pages. An MX with protocol 2.0 firmware has a different control table and model
number. docs/servos.md lists the sources against which each line was checked. Words are little endian. Bit 10 of a speed
or load is the direction: 1 is clockwise, toward smaller positions.
"""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from drivers.servos.register import Access, Datasheet, Register, ServoModel, between, bit_names, by_address, merged

READ: Final = Access.READ
LEVELS: Final = between(0, 2)
OFFSETS: Final = between(-24576, 24576)
BYTE: Final = between(0, 254)
TEN_BITS: Final = between(0, 1023)
SWITCH: Final = between(0, 1)

# EEPROM.
model_number = Register("model_number", 0, 2, READ, persistent=True)
firmware_version = Register("firmware_version", 2, 1, READ, persistent=True)
servo_id = Register("id", 3, 1, persistent=True, values=between(0, 253))
baud_rate = Register("baud_rate", 4, 1, persistent=True, values=BYTE)  # 2 Mbit/s divided by (value + 1)
return_delay = Register("return_delay", 5, 1, persistent=True, values=BYTE)  # 2 us
cw_angle_limit = Register("cw_angle_limit", 6, 2, persistent=True)  # counts
ccw_angle_limit = Register("ccw_angle_limit", 8, 2, persistent=True)  # counts; both 0: wheel mode
temperature_limit = Register("temperature_limit", 11, 1, persistent=True, values=between(0, 150))  # deg C
min_voltage_limit = Register("min_voltage_limit", 12, 1, persistent=True, values=between(50, 250))  # 0.1 V
max_voltage_limit = Register("max_voltage_limit", 13, 1, persistent=True, values=between(50, 250))  # 0.1 V
max_torque = Register("max_torque", 14, 2, persistent=True, values=TEN_BITS)  # 1/1023
status_return_level = Register("status_return_level", 16, 1, persistent=True, values=LEVELS)  # 1: ping and read, 2: all
alarm_led = Register("alarm_led", 17, 1, persistent=True, values=between(0, 127))  # error bits
shutdown = Register("shutdown", 18, 1, persistent=True, values=between(0, 127))  # error bits

# RAM: switches and goals.
torque_enable = Register("torque_enable", 24, 1, values=SWITCH)  # 0 off, 1 on
led = Register("led", 25, 1, values=SWITCH)
goal_position = Register("goal_position", 30, 2)  # counts
moving_speed = Register("moving_speed", 32, 2, values=between(0, 2047))  # the model's unit of speed; 0: maximum speed
torque_limit = Register("torque_limit", 34, 2, values=TEN_BITS)  # 1/1023; max_torque after power-on, 0 after a shutdown

# RAM: state. The first five registers are one block of eight bytes.
present_position = Register("present_position", 36, 2, READ)  # counts
present_speed = Register("present_speed", 38, 2, READ, sign_bit=10)  # the model's unit of speed
present_load = Register("present_load", 40, 2, READ, sign_bit=10)  # 1/1023 of full drive, estimated
present_voltage = Register("present_voltage", 42, 1, READ)  # 0.1 V
present_temperature = Register("present_temperature", 43, 1, READ)  # deg C
registered_instruction = Register("registered_instruction", 44, 1, READ)
moving = Register("moving", 46, 1, READ)
lock = Register("lock", 47, 1, values=SWITCH)  # 1: EEPROM is locked until power-off
punch = Register("punch", 48, 2, values=TEN_BITS)

COMMON: Final = by_address(globals().values())
"""Registers of all models. The position registers of a model depend on its sensor (``_positions``)."""

# The models differ in these registers: an AX has compliance settings, and an MX has gains.
cw_compliance_margin = Register("cw_compliance_margin", 26, 1)  # counts
ccw_compliance_margin = Register("ccw_compliance_margin", 27, 1)  # counts
cw_compliance_slope = Register("cw_compliance_slope", 28, 1, values=BYTE)
ccw_compliance_slope = Register("ccw_compliance_slope", 29, 1, values=BYTE)
_AX_ONLY: Final = (cw_compliance_margin, ccw_compliance_margin, cw_compliance_slope, ccw_compliance_slope)

multi_turn_offset = Register("multi_turn_offset", 20, 2, persistent=True, signed=True, values=OFFSETS)  # multi-turn
resolution_divider = Register("resolution_divider", 22, 1, persistent=True, values=between(1, 4))  # multi-turn
d_gain = Register("d_gain", 26, 1, values=BYTE)
i_gain = Register("i_gain", 27, 1, values=BYTE)
p_gain = Register("p_gain", 28, 1, values=BYTE)
realtime_tick = Register("realtime_tick", 50, 2, READ)  # ms; firmware 40 or later
goal_acceleration = Register("goal_acceleration", 73, 1, values=BYTE)  # 8.583 deg/s^2; 0: no ramp
_MX_ONLY: Final = (multi_turn_offset, resolution_divider, d_gain, i_gain, p_gain, realtime_tick, goal_acceleration)

# Only some models have these registers.
drive_mode = Register("drive_mode", 10, 1, persistent=True, values=between(0, 3))  # EX-106+, MX-106
sensed_current = Register("sensed_current", 56, 2, READ)  # EX-106+: 10 mA, 512 means no current
present_current = Register("present_current", 68, 2)  # MX-64, MX-106: 4.5 mA, 2048 means no current
torque_control_mode = Register("torque_control_mode", 70, 1, values=SWITCH)
goal_torque = Register("goal_torque", 71, 2, values=between(0, 2047))  # 4.5 mA, bit 10 is the direction
_CURRENT: Final = (present_current, torque_control_mode, goal_torque)

STATE_BLOCK: Final = (present_position, present_speed, present_load, present_voltage, present_temperature)
GOAL_BLOCK: Final = (goal_position, moving_speed)

ERROR_BITS: Final = dict(
    enumerate(("voltage", "angle limit", "temperature", "range", "checksum", "overload", "instruction"))
)
"""Meaning of the bits of a reply's error byte. The bits in ``REFUSALS`` report instruction errors."""
REFUSALS: Final = 1 << 3 | 1 << 4 | 1 << 6
CORRUPT_PACKET: Final = 1 << 4
"""Bit of ``REFUSALS`` that reports a corrupt instruction packet."""

ANSWERS_ALL: Final = 2
"""Value of ``status_return_level`` at which writes are acknowledged."""
FULL_TORQUE: Final = 1023
LARGEST_SPEED: Final = 1023
VOLTAGE_UNIT_V: Final = 0.1
MULTI_TURN_LIMIT: Final = 4095
"""Value that, set for both angle limits, selects multi-turn mode on an MX."""
AX_POSITIONS: Final = 1024
"""Number of positions of an AX servo, over 300 degrees."""
ACCELERATION_UNIT_COUNTS_S2: Final = 8.583 * 4096 / 360.0
"""Unit of an MX servo's goal acceleration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxMxModel(ServoModel):
    """A servo model.

    ``own`` holds the registers that are not in ``COMMON``. The stall current is specified at the rated voltage.
    """

    speed_unit_counts_s: float
    """Unit of ``moving_speed`` and ``present_speed``."""
    bulk_read: bool
    """Whether the model supports bulk reads."""
    stall_current_a: float


def _positions(last: int) -> tuple[Register, ...]:
    """Return the registers that hold the positions of a sensor. ``last`` is the largest position."""
    return tuple(replace(r, values=between(0, last)) for r in (cw_angle_limit, ccw_angle_limit))


class Span(NamedTuple):
    """A potentiometer used as a position sensor, with its number of positions and the angle that they cover."""

    positions: int
    degrees: float


AX_SPAN: Final = Span(AX_POSITIONS, 300.0)
EX_SPAN: Final = Span(4096, 250.92)


def _ax(name: str, number: int, sheet: Datasheet, *own: Register, span: Span = AX_SPAN) -> AxMxModel:
    """Create a model with a potentiometer and compliance. ``own`` holds registers that an AX-12A does not have."""
    turn = round(span.positions * 360.0 / span.degrees)
    return AxMxModel(
        name, number, "little", turn, sheet.rated_voltage_v, sheet.stall_torque_nm, sheet.no_load_speed_rad_s,
        span.positions, _AX_ONLY + _positions(span.positions - 1) + own,
        speed_unit_counts_s=0.111 * turn / 60.0, bulk_read=False, stall_current_a=sheet.stall_current_a,
    )  # fmt: skip


def _mx(name: str, number: int, sheet: Datasheet, *own: Register, speed_unit_rpm: float = 0.114) -> AxMxModel:
    """Create a model with a magnetic encoder and gains. ``own`` holds registers that an MX-28 does not have."""
    return AxMxModel(
        name, number, "little", 4096, sheet.rated_voltage_v, sheet.stall_torque_nm, sheet.no_load_speed_rad_s,
        None, _MX_ONLY + _positions(4095) + own,
        speed_unit_counts_s=speed_unit_rpm * 4096 / 60.0, bulk_read=True, stall_current_a=sheet.stall_current_a,
    )  # fmt: skip


AX_12A = _ax("ax-12a", 12, Datasheet(12.0, 1.5, 1.5, 59.0))
AX_12W = _ax("ax-12w", 300, Datasheet(12.0, 0.19, 1.5, 470.0))  # torque of the AX-12A, converted by the gear ratio
AX_18A = _ax("ax-18a", 18, Datasheet(12.0, 1.8, 2.2, 97.0))
RX_24F = _ax("rx-24f", 24, Datasheet(12.0, 2.6, 2.4, 126.0))
# The datasheets of these three models specify values at 18.5 V. These values are converted to 14.8 V, the recommended
# voltage.
RX_28 = _ax("rx-28", 28, Datasheet(14.8, 2.96, 1.52, 68.0))
RX_64 = _ax("rx-64", 64, Datasheet(14.8, 4.24, 2.08, 51.2))
EX_106 = _ax("ex-106+", 107, Datasheet(14.8, 8.72, 5.6, 72.8), drive_mode, sensed_current, span=EX_SPAN)
MX_12W = _mx("mx-12w", 360, Datasheet(12.0, 0.19, 1.5, 470.0), speed_unit_rpm=0.916)  # same torque as the AX-12W
MX_28 = _mx("mx-28", 29, Datasheet(12.0, 2.5, 1.4, 55.0))  # protocol 1.0 firmware
MX_64 = _mx("mx-64", 310, Datasheet(12.0, 6.0, 4.1, 63.0), *_CURRENT)
MX_106 = _mx("mx-106", 320, Datasheet(12.0, 8.4, 5.2, 45.0), drive_mode, *_CURRENT)

MODELS: Final = {model.name: model for model in list(globals().values()) if isinstance(model, AxMxModel)}


def speed_unit_counts_s(model: ServoModel) -> float:
    """Return a model's unit of speed, in counts/s.

    Args:
        model: A model of this module, or one that a user added to it.

    Returns:
        The unit of ``moving_speed`` and ``present_speed``, in counts/s.

    Raises:
        TypeError: The model belongs to another series.
    """
    if not isinstance(model, AxMxModel):
        raise TypeError(f"{model.name} is not an AX or MX servo with protocol 1.0")
    return model.speed_unit_counts_s


def registers(model: AxMxModel) -> tuple[Register, ...]:
    return merged(COMMON, model.own)


def alarms(error: int) -> tuple[str, ...]:
    return bit_names(error, ERROR_BITS)
