"""Which bus drives which servos, and every model by name."""

from collections.abc import Mapping
from typing import Final, Literal

from drivers.bus import ServoBus
from drivers.clock import Clock
from drivers.dynamixel import models as dynamixel2
from drivers.dynamixel import x_series
from drivers.dynamixel.bus import DynamixelBus
from drivers.dynamixel1 import tables as dynamixel1
from drivers.feetech import models as feetech
from drivers.feetech import sts
from drivers.feetech.bus import FeetechBus
from drivers.port import Port
from drivers.read_each import series as read_each
from drivers.read_each.bus import ReadEachBus
from drivers.registers import Register, ServoModel

Make = Literal["feetech", "dynamixel"]

MODELS: Final[dict[str, ServoModel]] = {**feetech.MODELS, **dynamixel2.MODELS, **dynamixel1.MODELS}
"""Every servo that can be driven, by the name it has in files."""


def make_of(model: ServoModel) -> Make:
    """Who makes it."""
    return "feetech" if model in feetech.MODELS.values() else "dynamixel"


def model_numbers(model: ServoModel) -> tuple[Register, Register]:
    """Where a servo has the number of its model, and where it would be if it were of the other make."""
    here, there = sts.model_number, x_series.model_number
    return (here, there) if make_of(model) == "feetech" else (there, here)


def table_of(model: ServoModel) -> str:
    """The name of its control table: models with one differ in their motors, and in registers of no moment here."""
    if make_of(model) == "feetech":
        return feetech.series_of(model).name
    in_protocol_2 = model in dynamixel2.MODELS.values()
    return dynamixel2.series_of(model).name if in_protocol_2 else language_of(model)


def id_register(model: ServoModel) -> Register:
    """Where a servo has its ID."""
    if make_of(model) == "feetech":
        return sts.servo_id
    return x_series.servo_id if model in x_series.MODELS.values() else dynamixel1.servo_id


def language_of(model: ServoModel) -> str:
    """How it speaks: only servos that speak alike can share a line."""
    for series in read_each.SERIES:
        if model in series.models:
            return series.name
    if make_of(model) == "feetech":
        return f"Feetech {feetech.series_of(model).name.upper()}"
    return "Dynamixel protocol 2.0"


def bus_for(
    models: Mapping[int, ServoModel], port: Port, clock: Clock, position_p: Mapping[int, int] | None = None
) -> ServoBus:
    """The bus that drives these servos, by ID. ``position_p``: P gains that Dynamixels are given with the torque.

    ValueError for servos that cannot share a line.
    """
    languages = {language_of(model) for model in models.values()}
    if len(languages) > 1:
        raise ValueError(f"{port.name}: these servos cannot share a line: {_by_language(models)}")
    match languages.pop() if languages else "Feetech STS":
        case "Feetech STS":
            return FeetechBus(port, clock)
        case "Dynamixel protocol 2.0":
            return DynamixelBus(port, clock, models, position_p=position_p)
        case _:
            return ReadEachBus(port, clock, models)


def _by_language(models: Mapping[int, ServoModel]) -> str:
    """Who speaks what."""
    spoken: dict[str, list[str]] = {}
    for servo_id, model in models.items():
        spoken.setdefault(language_of(model), []).append(f"{servo_id} ({model.name})")
    return "; ".join(f"{language}: {', '.join(servos)}" for language, servos in spoken.items())
