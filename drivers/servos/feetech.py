"""The Feetech series STS and SCS: the wire protocols, and the encoding of states and goals.

Both series use the packets of Dynamixel protocol 1.0. STS servos are little endian (protocol 0 of Feetech's SDK) and
support sync reads. SCS servos are big endian (protocol 1) and must be read one by one.
"""

from collections.abc import Callable
from functools import partial
from struct import Struct
from typing import Final

from scservo_sdk import PacketHandler
from scservo_sdk.protocol_packet_handler import protocol_packet_handler

from drivers.protocol import v1
from drivers.servos import scs, sts
from drivers.servos.register import ServoModel, signed
from drivers.servos.series import Read, Series, WireProtocol, blocks_from_start, check_goal
from drivers.types import ServoGoal, ServoState

STS_PROTOCOL: Final = WireProtocol(
    name="Feetech STS",
    packets=v1,
    byte_order="little",
    sdk=lambda: PacketHandler(0),
    group_read="sync",
    reboot="unanswered",  # Feetech's protocol manual
)
SCS_PROTOCOL: Final = WireProtocol(
    name="Feetech SCS",
    packets=v1,
    byte_order="big",
    # The SDK's PacketHandler(1) would change the byte order for all users of the SDK in this process.
    sdk=protocol_packet_handler,
    group_read="none",
    reboot="unanswered",
)

# Lookup tables for all values of narrow registers, because lookups are faster than calculations.
_ALARMS: Final = tuple(sts.alarms(status) for status in range(256))
_LOADS: Final = tuple(signed(raw, 1 << 10) * sts.TORQUE_UNIT for raw in range(1 << 11))
_STS_LOADS: Final = tuple(0.0 - load for load in _LOADS)  # an STS reports a positive load toward smaller counts
_VOLTAGES_V: Final = tuple(raw * sts.VOLTAGE_UNIT_V for raw in range(256))
_TEMPERATURES_C: Final = tuple(float(raw) for raw in range(256))
_SIGN: Final = 1 << 15
_MAGNITUDE: Final = _SIGN - 1
_new: Final = tuple.__new__
assert {sts.present_position.sign_bit, sts.present_velocity.sign_bit, sts.goal_position.sign_bit} == {15}


def _state(loads: tuple[float, ...], _scale: None, status: int, *numbers: int) -> ServoState:
    """Convert register values to a state. Each control cycle calls this for every servo."""
    position, velocity, load, volts, celsius = numbers
    if position & _SIGN:
        position = _SIGN - position
    if velocity & _SIGN:
        velocity = _SIGN - velocity
    fields = (
        position, velocity, loads[load & 0x7FF], _VOLTAGES_V[volts], _TEMPERATURES_C[celsius], _ALARMS[status],
        None,
    )  # fmt: skip
    return _new(ServoState, fields)


def _sts_goal(wanted: ServoGoal) -> tuple[int, ...]:
    """Encode a goal. The servo's own ramp gets a fixed acceleration, so that its following error is predictable."""
    position, velocity = wanted
    if (position | velocity) & ~_MAGNITUDE:  # negative or too large
        if velocity < 0:  # the register has a sign bit, which has no meaning in position mode
            raise ValueError(f"goal velocity must be 0 or more, not {velocity}: nothing was written")
        sts.goal_velocity.check(velocity)
        position = int.from_bytes(sts.goal_position.encode(position, "little"), "little")
    return sts.GOAL_ACCELERATION, position, 0, velocity


def _sts_config_error(model: ServoModel, read: Read) -> str | None:
    mode, factor = sts.operating_mode, sts.angular_resolution
    if read(mode):
        return f"is not in position mode: set {mode.name} ({mode.address}) to 0"
    if (times := read(factor)) > 1:  # the firmware treats 0 as 1
        return f"multiplies every goal by {times}: set {factor.name} ({factor.address}) to 1"
    return None


def _sts_config_warning(read: Read) -> str | None:
    """Return a warning if the unit of speed is unsuitable. This is not an error, because a simulator with an empty
    table still works."""
    phase = read(sts.phase)
    if phase & sts.COUNTS_PER_S_PHASE:
        return None
    return (
        f"phase (register {sts.phase.address}) is {phase}, so according to Feetech the unit of speed is 50 "
        "counts/s. "
        f"servoloop needs a unit of 1 count/s: set phase to {phase | sts.COUNTS_PER_S_PHASE}"
    )


STS: Final = Series(
    name="sts",
    make="feetech",
    protocol=STS_PROTOCOL,
    by_name=sts.MODELS,
    registers=sts.REGISTERS,
    goal_block=sts.GOAL_BLOCK,
    # All blocks end within the control table. The lengths of the blocks differ in at least two bits, so that a single
    # flipped bit cannot turn one length into another.
    blocks=blocks_from_start(sts.STATE_BLOCK, (8, 10, 13, 15), Struct("<HHHBB"), partial(_state, _STS_LOADS)),
    goal_fields="BHHH",
    goal_of=lambda model: _sts_goal,
    servo_id=sts.servo_id,
    model_number=sts.model_number,
    status_level=sts.status_level,
    answers_all=1,
    harmless=sts.acceleration,
    torque_enable=sts.torque_enable,
    goal_position=sts.goal_position,
    position_limits=sts.POSITION_LIMITS,
    max_torque=sts.max_torque,
    torque_limit=sts.torque_limit,
    full_torque=1000,
    config_error=_sts_config_error,
    config_warning=_sts_config_warning,
    lock=sts.lock,
)


def _scs_goal_of(model: ServoModel) -> Callable[[ServoGoal], tuple[int, ...]]:
    def goal(wanted: ServoGoal) -> tuple[int, ...]:
        check_goal(model.last_count, wanted)
        return wanted.position_counts, 0, min(wanted.velocity_counts_s, scs.goal_velocity.largest)

    return goal


def _scs_config_error(model: ServoModel, read: Read) -> str | None:
    if read(scs.min_position) == read(scs.max_position) == 0:
        return "is in motor mode, in which it has no goal position: set its position limits (registers 9 and 11)"
    return None


SCS: Final = Series(
    name="scs",
    make="feetech",
    protocol=SCS_PROTOCOL,
    by_name=scs.MODELS,
    registers=scs.REGISTERS,
    goal_block=scs.GOAL_BLOCK,
    # The memory table ends at address 66, while the table in Feetech's header file for the series ends at 70.
    blocks=blocks_from_start(scs.STATE_BLOCK, (8, 10, 13, 15), Struct(">HHHBB"), partial(_state, _LOADS)),
    goal_fields="HHH",
    goal_of=_scs_goal_of,
    servo_id=scs.servo_id,
    model_number=scs.model_number,
    status_level=scs.status_level,
    answers_all=1,
    torque_enable=scs.torque_enable,
    goal_position=scs.goal_position,
    position_limits=(scs.min_position, scs.max_position),
    max_torque=scs.max_torque,
    torque_limit=None,
    full_torque=1000,
    config_error=_scs_config_error,
    lock=scs.lock,
)


SERIES: Final = tuple(series for series in list(globals().values()) if isinstance(series, Series))
