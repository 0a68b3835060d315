"""The Dynamixel series AX and MX with protocol 1.0: the wire protocol, and the encoding of states and goals."""

from struct import Struct
from typing import Final

from dynamixel_sdk import Protocol1PacketHandler

from drivers.protocol import v1
from drivers.servos import ax_mx
from drivers.servos.register import ServoModel
from drivers.servos.series import Read, Series, WireProtocol, bit_10_goal_of, bit_10_state, blocks_from_start
from drivers.types import ServoState

PROTOCOL_1: Final = WireProtocol(
    name="Dynamixel protocol 1.0",
    packets=v1,
    byte_order="little",
    sdk=Protocol1PacketHandler,
    group_read="bulk",
    waits_for_silent=True,
    refusals=ax_mx.REFUSALS,
    refusal=lambda bits: f"rejected the instruction ({' and '.join(ax_mx.alarms(bits))} error)",
    arrived_corrupt=lambda bits: bool(bits & ax_mx.CORRUPT_PACKET),
    reboot="none",
)
_ALARMS: Final = tuple(ax_mx.alarms(error) for error in range(256))


def _ax_mx_state(unit_counts_s: float, error: int, *numbers: int) -> ServoState:
    return bit_10_state(unit_counts_s, _ALARMS[error], numbers)


def _ax_mx_config_error(model: ServoModel, read: Read) -> str | None:
    limits = {read(ax_mx.cw_angle_limit), read(ax_mx.ccw_angle_limit)}
    if limits == {0}:
        return "is in wheel mode: set its angle limits (registers 6 and 8) to its range of motion"
    if limits == {ax_mx.MULTI_TURN_LIMIT}:
        return "is in multi-turn mode: set its angle limits (registers 6 and 8) to 0 and 4095"
    return None


AX_MX: Final = Series(
    name="Dynamixel protocol 1.0",
    make="dynamixel",
    protocol=PROTOCOL_1,
    by_name=ax_mx.MODELS,
    registers=ax_mx.COMMON,
    goal_block=ax_mx.GOAL_BLOCK,
    # The control table of an AX ends at address 49.
    blocks=blocks_from_start(ax_mx.STATE_BLOCK, (8, 10, 13, 14), Struct("<HHHBB"), _ax_mx_state),
    goal_fields="HH",
    goal_of=lambda model: bit_10_goal_of(model.last_count, ax_mx.speed_unit_counts_s(model)),
    scale_of=ax_mx.speed_unit_counts_s,
    servo_id=ax_mx.servo_id,
    model_number=ax_mx.model_number,
    status_level=ax_mx.status_return_level,
    answers_all=ax_mx.ANSWERS_ALL,
    torque_enable=ax_mx.torque_enable,
    goal_position=ax_mx.goal_position,
    position_limits=(ax_mx.cw_angle_limit, ax_mx.ccw_angle_limit),
    max_torque=ax_mx.max_torque,
    torque_limit=ax_mx.torque_limit,
    full_torque=ax_mx.FULL_TORQUE,
    config_error=_ax_mx_config_error,
    bulk_read=lambda model: isinstance(model, ax_mx.AxMxModel) and model.bulk_read,
)


SERIES: Final = (AX_MX,)
