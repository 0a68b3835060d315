"""All Feetech models, and what a bus must know of the series that a model belongs to."""

from dataclasses import dataclass
from typing import Final, Literal

from drivers.eeprom import Lock
from drivers.feetech import scs, sts
from drivers.registers import ByteOrder, Register, ServoModel


@dataclass(frozen=True, slots=True)
class Series:
    """What servos of one series share.

    ``protocol`` is the number that Feetech's SDK wants: 0 says low byte first, 1 high byte first; the
    packets are the same. Without ``sync_read``, each servo must be asked by itself.
    """

    name: str
    protocol: Literal[0, 1]
    byte_order: ByteOrder
    sync_read: bool
    registers: tuple[Register, ...]
    state_block: tuple[Register, ...]
    goal_block: tuple[Register, ...]
    torque_enable: Register
    lock: Lock
    models: tuple[ServoModel, ...]


STS: Final = Series(
    name="sts",
    protocol=0,
    byte_order="little",
    sync_read=True,
    registers=sts.REGISTERS,
    state_block=sts.STATE_BLOCK,
    goal_block=sts.GOAL_BLOCK,
    torque_enable=sts.torque_enable,
    lock=Lock(sts.lock),
    models=tuple(sts.MODELS.values()),
)
SCS: Final = Series(
    name="scs",
    protocol=1,
    byte_order="big",
    sync_read=False,
    registers=scs.REGISTERS,
    state_block=scs.STATE_BLOCK,
    goal_block=scs.GOAL_BLOCK,
    torque_enable=scs.torque_enable,
    lock=Lock(scs.lock),
    models=tuple(scs.MODELS.values()),
)
SERIES: Final = tuple(series for series in list(globals().values()) if isinstance(series, Series))

MODELS: Final = {model.name: model for series in SERIES for model in series.models}
"""Every Feetech model by name."""


def series_of(model: ServoModel) -> Series:
    """The series of one of ``MODELS``; ValueError for a servo of another make."""
    for series in SERIES:
        if model in series.models:
            return series
    raise ValueError(f"{model.name} is no Feetech model: known are {', '.join(MODELS)}")
