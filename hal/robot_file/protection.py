"""Check that a joint's torque limit is compatible with the protection settings of its servo."""

from collections.abc import Iterator, Mapping
from typing import Final

from drivers.servos import scs, sts, x
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel

FACTORY: Final[Mapping[str, int]] = {"overload_torque": 80, "protective_torque": 20, "unloading_condition": 44}
"""Assumed settings of a Feetech servo for which the robot file does not set values."""
OVERLOAD_BIT: Final = 32
SWITCHES: Final = ("protection_current", "overcurrent_time")
SHUTDOWN_BITS: Final = {"overheating": 4, "overload": 32}
"""Bits of the ``shutdown`` register of a Dynamixel X."""


def protection_problems(model: ServoModel, torque_limit: float, settings: Mapping[str, int]) -> Iterator[str]:
    """Yield a message for each protection that cannot take effect and each torque limit that cannot be reached."""
    series = series_of(model)
    lasting = series.max_torque
    highest = settings.get(lasting.name, series.full_torque) / series.full_torque
    if round(torque_limit * series.full_torque) > round(highest * series.full_torque):
        yield (
            f"torque_limit {torque_limit:g} is above {highest:.3g}, the limit set by {lasting.name} "
            f"{settings[lasting.name]}: lower torque_limit to {highest:.3g}, or raise {lasting.name}"
        )
    if model in sts.MODELS.values() or model in scs.MODELS.values():
        yield from _feetech(min(torque_limit, highest), {**FACTORY, **settings})
    mask = settings.get("shutdown")
    if mask is not None and model in x.MODELS.values():
        for alarm, bit in SHUTDOWN_BITS.items():
            if not mask & bit:
                yield f"shutdown {mask} does not stop the servo at {alarm}: add {bit} to shutdown"


def _feetech(limit: float, held: Mapping[str, int]) -> Iterator[str]:
    overload, protective, mask = (held[name] for name in FACTORY)
    percent = round(100 * limit)
    if overload >= percent:
        yield (
            f"overload_torque {overload} % is not below the torque limit of {percent} %, so the overload protection of "
            f"the servo can never act. Add settings: {{overload_torque: {max(percent // 2, 1)}}}"
        )
    elif protective >= overload:
        yield (
            f"protective_torque {protective} % is not below overload_torque {overload} %, so an overload does not "
            f"reduce the torque: lower protective_torque below {overload}"
        )
    for name in SWITCHES:
        if held.get(name) == 0:
            yield f"{name} 0 disables the overcurrent protection of the servo: remove this setting, or set it above 0"
    if not mask & OVERLOAD_BIT:
        yield (
            f"unloading_condition {mask} disables the overload protection of the servo: set it to {mask | OVERLOAD_BIT}"
        )
