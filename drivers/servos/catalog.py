"""Catalog of all supported servo models and their series."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Final, Literal

from drivers.protocol import v1
from drivers.servos import dynamixel, dynamixel1, feetech
from drivers.servos.register import Register, ServoModel, merged
from drivers.servos.series import Series, WireProtocol

Make = Literal["feetech", "dynamixel"]

SERIES: Final = feetech.SERIES + dynamixel.SERIES + dynamixel1.SERIES
MODELS: Final[dict[str, ServoModel]] = {model.name: model for series in SERIES for model in series.models}
"""All supported servo models, keyed by their name in robot files."""


UNSUPPORTED: Final[Mapping[int, str]] = {
    2000: "PH42-020-S300", 2010: "PH54-100-S500", 2020: "PH54-200-S500",
    2100: "PM42-010-S260", 2110: "PM54-040-S250", 2120: "PM54-060-S250",
    4000: "YM070-210-M001", 4010: "YM070-210-B001", 4020: "YM070-210-R051",
    4030: "YM070-210-R099", 4040: "YM070-210-A051", 4050: "YM070-210-A099",
    4120: "YM080-230-M001", 4130: "YM080-230-B001", 4140: "YM080-230-R051",
    4150: "YM080-230-R099", 4160: "YM080-230-A051", 4170: "YM080-230-A099",
    35074: "RH-P12-RN", 43289: "M42-10-S260-RA", 46097: "M54-40-S250-RA", 46353: "M54-60-S250-RA",
    51201: "H42-20-S300-RA", 53769: "H54-100-S500-RA", 54025: "H54-200-S500-RA",
}  # fmt: skip
"""Dynamixel models with protocol 2.0 whose control tables differ from all supported control tables, keyed by model
number.

Source: ``dynamixel.model`` of ROBOTIS' SDK (dynamixel_easy_sdk 4.1).
"""

_ADDED: Final[dict[str, ServoModel]] = {}
"""Models that the user added, keyed by name."""
_FILES: Final[dict[str, Path]] = {}
"""File that defines each added model, keyed by the name of the model."""


def add(model: ServoModel, like: ServoModel, file: Path) -> None:
    """Add a user's model to the series of another model.

    A model that the same file has added earlier with the same name is replaced, so that a file can be read again.

    Args:
        model: The new model.
        like: A supported model with the same control table and protocol.
        file: Absolute path of the file that defines the model.

    Raises:
        ValueError: A built-in model already has this name, another file defines a different model with this name, or
            another model of the manufacturer already has this number.
    """
    series = series_of(like)
    if model.name in MODELS and model.name not in _ADDED:
        raise ValueError(f"servoloop already has a model {model.name}: choose another name")
    taken = [m for m in _numbered(model.number, series) if m.name != model.name and m.name not in _ADDED]
    if taken and like not in taken:
        raise ValueError(
            f"model number {model.number} belongs to {taken[0].name}: write `like: {taken[0].name}` for a variant of "
            "this model, or correct the number"
        )
    if known := _ADDED.get(model.name):
        if known != model and _FILES[model.name] != file:  # joints of another arm use the known model
            raise ValueError(f"{_FILES[model.name]} defines another model {model.name}: rename one of the two models")
        series_of(known).by_name.pop(model.name)
    _FILES.setdefault(model.name, file)
    series.by_name[model.name] = MODELS[model.name] = _ADDED[model.name] = model


def is_added(model: ServoModel) -> bool:
    """Return whether a user added this model."""
    return model.name in _ADDED


def series_of(model: ServoModel) -> Series:
    """Return the series of a model. Raises ValueError if the model is not in ``MODELS``."""
    for series in SERIES:
        if series.by_name.get(model.name) == model:
            return series
    raise ValueError(f"{model.name} is not a supported servo model: {model_advice(model.name)}")


def registers_of(model: ServoModel) -> tuple[Register, ...]:
    """Return the control table of a model, sorted by address.

    Args:
        model: A supported model.

    Returns:
        The registers of the model's series and its own registers.

    Raises:
        ValueError: The model is not in ``MODELS``.
    """
    return merged(series_of(model).registers, model.own)


def wire_protocol(models: Mapping[int, ServoModel]) -> WireProtocol:
    """Return the wire protocol of these servos (STS if there are none).

    Raises ValueError if the servos cannot share a bus.
    """
    spoken: dict[WireProtocol, list[str]] = {}
    for servo_id, model in models.items():
        spoken.setdefault(series_of(model).protocol, []).append(f"{servo_id} ({model.name})")
    if len(spoken) > 1:
        described = "; ".join(f"{protocol.name}: {', '.join(servos)}" for protocol, servos in spoken.items())
        raise ValueError(f"servos with different protocols cannot share a bus: {described}")
    return next(iter(spoken), feetech.STS_PROTOCOL)


def too_many(models: Iterable[ServoModel]) -> Iterator[str]:
    """Yield a message for each series whose goals do not fit into one packet, worded to follow the name of a bus."""
    for series, count in Counter(map(series_of, models)).items():
        most = v1.LARGEST_BODY // (series.goal_size + 1)
        if series.protocol.packets is v1 and count > most:
            yield (
                f"has {count} servos of the series {series.name}, but a packet holds at most {most} goals: connect "
                "some of these servos to another bus"
            )


def known_as(number: int, series: Series) -> str:
    """Return the names of the manufacturer's models with this number, in either byte order."""
    names = [model.name for model in _numbered(number, series)]
    return " or ".join(names) or unsupported(number, series) or "unknown"


def model_advice(name: str, known: Iterable[str] | None = None) -> str:
    """Return which models to use instead of an unknown model: the closest names.

    Args:
        name: Unknown name.
        known: Names to choose from; all models if None.
    """
    near = get_close_matches(name[:50], MODELS if known is None else known, cutoff=0.4)
    every = "'servoloop register tables' lists all models"
    return f"use one of {', '.join(near)} ({every})" if near else every


def other_rated_voltages(model: ServoModel) -> list[float]:
    """Return the rated voltages, in V, of models that report the same model number but differ in their rated voltage.

    Such models cannot be distinguished over the wire.
    """
    voltages = {other.rated_voltage_v for other in _numbered(model.number, series_of(model))}
    return sorted(voltages - {model.rated_voltage_v})


def has_table(number: int, series: Series) -> bool:
    """Return whether a supported model of the manufacturer has this number, in either byte order."""
    return bool(_numbered(number, series))


def unsupported(number: int, series: Series) -> str:
    """Return the name of a model with an unsupported control table.

    Args:
        number: Model number that the servo reports.
        series: Series that was assumed when the servo was read.

    Returns:
        The name; an empty string if the number is unknown or the model is supported.
    """
    return UNSUPPORTED.get(number, "") if series.protocol is dynamixel.PROTOCOL_2 else ""


def _numbered(number: int, series: Series) -> list[ServoModel]:
    """Return the manufacturer's models with this number, in either byte order."""
    number_bytes = number.to_bytes(2, series.protocol.byte_order)
    relatives = [model for each in SERIES if each.make == series.make for model in each.models]
    return [m for m in relatives if m.number == int.from_bytes(number_bytes, m.byte_order)]
