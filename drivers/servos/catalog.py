"""Catalog of all supported servo models and their series."""

from collections.abc import Mapping
from typing import Final, Literal

from drivers.servos import dynamixel, dynamixel1, feetech
from drivers.servos.register import ServoModel
from drivers.servos.series import Series, WireProtocol

Make = Literal["feetech", "dynamixel"]

SERIES: Final = feetech.SERIES + dynamixel.SERIES + dynamixel1.SERIES
MODELS: Final[dict[str, ServoModel]] = {model.name: model for series in SERIES for model in series.models}
"""All supported servo models, by their name in robot files."""


UNKNOWN_MODEL: Final = "unknown"
"""Name of a model number that no control table has."""


def series_of(model: ServoModel) -> Series:
    """Return the series of a model. Raise ValueError if the model is not in ``MODELS``."""
    for series in SERIES:
        if model in series.models:
            return series
    raise ValueError(f"{model.name} is not a supported servo model: choose one of {', '.join(sorted(MODELS))}")


def wire_protocol(models: Mapping[int, ServoModel]) -> WireProtocol:
    """Return the wire protocol of these servos (STS if there are none). Raise ValueError if they cannot share a bus."""
    spoken: dict[WireProtocol, list[str]] = {}
    for servo_id, model in models.items():
        spoken.setdefault(series_of(model).protocol, []).append(f"{servo_id} ({model.name})")
    if len(spoken) > 1:
        described = "; ".join(f"{protocol.name}: {', '.join(servos)}" for protocol, servos in spoken.items())
        raise ValueError(f"servos with different protocols cannot share a bus: {described}")
    return next(iter(spoken), feetech.STS_PROTOCOL)


def known_as(number: int, series: Series) -> str:
    """Return the names of the manufacturer's models with this number, in either byte order."""
    number_bytes = number.to_bytes(2, series.protocol.byte_order)
    relatives = [model for each in SERIES if each.make == series.make for model in each.models]
    names = [m.name for m in relatives if m.number == int.from_bytes(number_bytes, m.byte_order)]
    return " or ".join(names) or UNKNOWN_MODEL
