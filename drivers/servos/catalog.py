"""The catalog has every servo that can be driven, by the name it has in files, and its series."""

from collections.abc import Mapping
from typing import Final, Literal

from drivers.servos import dynamixel, dynamixel1, feetech
from drivers.servos.register import ServoModel
from drivers.servos.series import Series, WireProtocol

Make = Literal["feetech", "dynamixel"]

SERIES: Final = feetech.SERIES + dynamixel.SERIES + dynamixel1.SERIES
MODELS: Final[dict[str, ServoModel]] = {model.name: model for series in SERIES for model in series.models}
"""Every servo that can be driven, by the name it has in files."""


def series_of(model: ServoModel) -> Series:
    """The series of one of ``MODELS``; ValueError for another servo."""
    for series in SERIES:
        if model in series.models:
            return series
    raise ValueError(f"{model.name} is no servo that is known: known are {', '.join(sorted(MODELS))}")


def wire_protocol(models: Mapping[int, ServoModel]) -> WireProtocol:
    """How the servos of one line (by ID) speak; no servos speak as an STS.

    ValueError for servos that cannot share a line.
    """
    spoken: dict[WireProtocol, list[str]] = {}
    for servo_id, model in models.items():
        spoken.setdefault(series_of(model).protocol, []).append(f"{servo_id} ({model.name})")
    if len(spoken) > 1:
        said = "; ".join(f"{protocol.name}: {', '.join(servos)}" for protocol, servos in spoken.items())
        raise ValueError(f"these servos cannot share a line: {said}")
    return next(iter(spoken), feetech.STS_PROTOCOL)


def known_as(number: int, series: Series) -> str:
    """The model of any series of this make that says ``number``, whatever its byte order."""
    said = number.to_bytes(2, series.protocol.byte_order)
    relatives = [model for each in SERIES if each.make == series.make for model in each.models]
    names = [m.name for m in relatives if m.number == int.from_bytes(said, m.byte_order)]
    return " or ".join(names) or "unknown"
