"""Whether a joint's torque limit and its servo's own protections fit each other."""

from collections.abc import Iterator, Mapping
from typing import Final

from drivers.servos import scs, sts, x
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel

FACTORY: Final[Mapping[str, int]] = {"overload_torque": 80, "protective_torque": 20, "unloading_condition": 44}
"""What a Feetech servo is taken to hold if the robot file does not name it."""
OVERLOAD_BIT: Final = 32
SWITCHES: Final = ("protection_current", "overcurrent_time")
SHUTDOWN_BITS: Final = {"overheating": 4, "overload": 32}
"""Bits of an X series servo's ``shutdown``."""


def protection_problems(model: ServoModel, torque_limit: float, settings: Mapping[str, int]) -> Iterator[str]:
    """Yields each protection that cannot act, and each limit that cannot be reached, with the remedy."""
    series = series_of(model)
    lasting = series.max_torque
    highest = settings.get(lasting.name, series.full_torque) / series.full_torque
    if round(torque_limit * series.full_torque) > round(highest * series.full_torque):
        yield (
            f"torque_limit {torque_limit:g} is above {lasting.name} {settings[lasting.name]} of its settings, which is "
            f"{highest:.3g}: lower torque_limit to {highest:.3g}, or raise {lasting.name}"
        )
    if model in sts.MODELS.values() or model in scs.MODELS.values():
        yield from _feetech(min(torque_limit, highest), {**FACTORY, **settings})
    mask = settings.get("shutdown")
    if mask is not None and model in x.MODELS.values():
        for alarm, bit in SHUTDOWN_BITS.items():
            if not mask & bit:
                yield f"shutdown {mask} lets the servo go on at {alarm}: add {bit} to it"


def _feetech(limit: float, held: Mapping[str, int]) -> Iterator[str]:
    overload, protective, mask = (held[name] for name in FACTORY)
    percent = round(100 * limit)
    if overload >= percent:
        yield (
            f"overload_torque {overload} % is not below the torque limit of {percent} %, so the servo's overload "
            f"protection can never act: add settings: {{overload_torque: {max(percent // 2, 1)}}}"
        )
    elif protective >= overload:
        yield (
            f"protective_torque {protective} % is not below overload_torque {overload} %, so an overload reduces "
            f"nothing: lower protective_torque below {overload}"
        )
    for name in SWITCHES:
        if held.get(name) == 0:
            yield f"{name} 0 switches the servo's over-current protection off: take it out, or set it above 0"
    if not mask & OVERLOAD_BIT:
        yield (
            f"unloading_condition {mask} switches the servo's overload protection off: set it to {mask | OVERLOAD_BIT}"
        )
