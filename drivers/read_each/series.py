"""What the bus must know of the servos on its line: one series is one way to speak."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from struct import Struct
from typing import Any, Final

from dynamixel_sdk import Protocol1PacketHandler
from scservo_sdk.protocol_packet_handler import protocol_packet_handler

from drivers.bus import ServoGoal, ServoState
from drivers.dynamixel.models import MODELS as DYNAMIXEL2_MODELS
from drivers.dynamixel1 import tables as dxl
from drivers.feetech import scs, sts
from drivers.feetech.models import MODELS as FEETECH_MODELS
from drivers.registers import ByteOrder, Register, ServoModel

Read = Callable[[Register], int]
StateOf = Callable[[int, bytes], ServoState]
"""From a reply's status byte and data, which begin with the state block."""
GoalOf = Callable[[ServoGoal], bytes]


@dataclass(frozen=True, slots=True)
class Series:
    """Servos that can share a line, because they speak alike.

    ``state_sizes``: how many bytes may be asked for from the state block's beginning, the block alone
    first; a servo that owes an answer is asked for another size. ``refusals``: bits of the status byte
    that refuse an instruction. ``misfit``: why the servo's settings do not fit, if so; it reads them.
    """

    name: str
    byte_order: ByteOrder
    sdk: Callable[[], Any]
    models: tuple[ServoModel, ...]
    bulk_models: tuple[ServoModel, ...]
    """Those that answer a bulk read."""
    model_number: Register
    status_level: Register
    answers_all: int
    """Value of ``status_level`` at which writes are acknowledged."""
    torque_enable: Register
    goal_position: Register
    position_limits: tuple[Register, Register]
    """The lowest and the highest goal."""
    state_address: int
    state_sizes: tuple[int, ...]
    goal_address: int
    goal_size: int
    max_torque: Register
    torque_limit: Register | None
    full_torque: int
    reboots: bool
    """Whether the protocol has that instruction."""
    refusals: int
    came_broken: int
    """That of them which says that the instruction's checksum was wrong; 0 where there is none."""
    alarms: Callable[[int], tuple[str, ...]]
    relatives: Mapping[str, ServoModel]
    """All models of the make, to name one that is found."""
    state_of: Callable[[ServoModel], StateOf]
    goal_of: Callable[[ServoModel], GoalOf]
    misfit: Callable[[ServoModel, Read], str | None]


def _size(block: tuple[Register, ...]) -> int:
    return sum(register.size for register in block)


def _goal_bytes(last: int, wanted: ServoGoal, *rest: int, order: ByteOrder) -> bytes:
    """Words of a goal block; ValueError where the position or the velocity is none that the servo has."""
    position = wanted.position_counts
    if not 0 <= position <= last:
        raise ValueError(f"goal_position takes 0 to {last}, not {position}: nothing written")
    # Before it is in the servo's units: there a small one may have become 0, which is as fast as it can.
    if wanted.velocity_counts_s < 0:
        raise ValueError(f"a goal's velocity is 0 or more, not {wanted.velocity_counts_s}: nothing written")
    return b"".join(word.to_bytes(2, order) for word in (position, *rest))


# Feetech SCS.

_SCS_STATE: Final = Struct(">HHHBB")
_SCS_ALARMS: Final = tuple(sts.alarms(status) for status in range(256))


def _signed(raw: int, sign: int) -> int:
    """A sign-magnitude number whose sign is the bit ``sign``."""
    return -(raw & sign - 1) if raw & sign else raw & sign - 1


def _scs_state_of(model: ServoModel) -> StateOf:
    def state(status: int, data: bytes) -> ServoState:
        position, velocity, load, voltage, temperature = _SCS_STATE.unpack_from(data)
        return ServoState(
            position,
            _signed(velocity, 1 << 15),
            _signed(load, 1 << 10) * sts.TORQUE_UNIT,
            voltage * sts.VOLTAGE_UNIT_V,
            float(temperature),
            _SCS_ALARMS[status],
        )

    return state


def _scs_goal_of(model: ServoModel) -> GoalOf:
    def goal(wanted: ServoGoal) -> bytes:
        speed = min(wanted.velocity_counts_s, scs.goal_velocity.largest)
        return _goal_bytes(model.last_count, wanted, 0, speed, order="big")

    return goal


def _scs_misfit(model: ServoModel, read: Read) -> str | None:
    if read(scs.min_position) == read(scs.max_position) == 0:
        return "is in motor mode, where a goal is no position: set its position limits (registers 9 and 11)"
    return None


SCS: Final = Series(
    name="Feetech SCS",
    byte_order="big",
    # Not the SDK's PacketHandler(1): that turns the words of every other user in this process round.
    sdk=protocol_packet_handler,
    models=tuple(scs.MODELS.values()),
    bulk_models=(),
    model_number=scs.model_number,
    status_level=scs.status_level,
    answers_all=1,
    torque_enable=scs.torque_enable,
    goal_position=scs.goal_position,
    position_limits=(scs.min_position, scs.max_position),
    state_address=scs.STATE_BLOCK[0].address,
    # The memory table ends at 66, Feetech's header of the series at 70.
    state_sizes=(8, 10, 13, 15),
    goal_address=scs.GOAL_BLOCK[0].address,
    goal_size=_size(scs.GOAL_BLOCK),
    max_torque=scs.max_torque,
    torque_limit=None,
    full_torque=1000,
    reboots=True,
    refusals=0,
    came_broken=0,
    alarms=sts.alarms,
    relatives=FEETECH_MODELS,
    state_of=_scs_state_of,
    goal_of=_scs_goal_of,
    misfit=_scs_misfit,
)

# Dynamixel protocol 1.0.

_DXL_STATE: Final = Struct("<HHHBB")
_DXL_ALARMS: Final = tuple(dxl.alarms(error) for error in range(256))


def _dxl_state_of(model: ServoModel) -> StateOf:
    unit_counts_s = dxl.SPEED_UNIT_COUNTS_S[model.name]

    def state(status: int, data: bytes) -> ServoState:
        position, speed, load, voltage, temperature = _DXL_STATE.unpack_from(data)
        return ServoState(
            position,
            round(_signed(speed, 1 << 10) * unit_counts_s),
            _signed(load, 1 << 10) / dxl.FULL_TORQUE,
            voltage * dxl.VOLTAGE_UNIT_V,
            float(temperature),
            _DXL_ALARMS[status],
        )

    return state


def _dxl_goal_of(model: ServoModel) -> GoalOf:
    unit_counts_s = dxl.SPEED_UNIT_COUNTS_S[model.name]

    def goal(wanted: ServoGoal) -> bytes:
        # Rounded up: the servo is never slower than asked, and 0 alone stays 0, as fast as it can.
        speed = min(math.ceil(wanted.velocity_counts_s / unit_counts_s), dxl.LARGEST_SPEED)
        return _goal_bytes(model.last_count, wanted, speed, order="little")

    return goal


def _dxl_misfit(model: ServoModel, read: Read) -> str | None:
    limits = {read(dxl.cw_angle_limit), read(dxl.ccw_angle_limit)}
    if limits == {0}:
        return "is in wheel mode: set its angle limits (registers 6 and 8) to the range it may move in"
    if limits == {dxl.MULTI_TURN_LIMIT}:
        return "is in multi-turn mode: set its angle limits (registers 6 and 8) to 0 and 4095"
    return None


DYNAMIXEL1: Final = Series(
    name="Dynamixel protocol 1.0",
    byte_order="little",
    sdk=Protocol1PacketHandler,
    models=tuple(dxl.MODELS.values()),
    bulk_models=tuple(model for model in dxl.MODELS.values() if model.bulk_read),
    model_number=dxl.model_number,
    status_level=dxl.status_return_level,
    answers_all=dxl.ANSWERS_ALL,
    torque_enable=dxl.torque_enable,
    goal_position=dxl.goal_position,
    position_limits=(dxl.cw_angle_limit, dxl.ccw_angle_limit),
    state_address=dxl.STATE_BLOCK[0].address,
    # An AX's table ends at 49.
    state_sizes=(8, 10, 13, 14),
    goal_address=dxl.GOAL_BLOCK[0].address,
    goal_size=_size(dxl.GOAL_BLOCK),
    max_torque=dxl.max_torque,
    torque_limit=dxl.torque_limit,
    full_torque=dxl.FULL_TORQUE,
    reboots=False,
    refusals=dxl.REFUSALS,
    came_broken=dxl.CAME_BROKEN,
    alarms=dxl.alarms,
    relatives={**DYNAMIXEL2_MODELS, **dxl.MODELS},
    state_of=_dxl_state_of,
    goal_of=_dxl_goal_of,
    misfit=_dxl_misfit,
)
SERIES: Final = tuple(series for series in list(globals().values()) if isinstance(series, Series))


def series_of(models: tuple[ServoModel, ...]) -> Series:
    """The series that all of them belong to; ValueError where there is none."""
    for series in SERIES:
        if all(model in series.models for model in models):
            return series
    names = ", ".join(sorted({model.name for model in models}))
    raise ValueError(f"{names} are not of one series that is read one by one")
