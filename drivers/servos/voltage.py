"""Check measured voltages against the voltage ranges of the servo models."""

from typing import Final, Literal, NamedTuple

from drivers.servos.register import ServoModel

LOWEST_SHARE: Final = 0.75
HIGHEST_SHARE: Final = 1.25
"""Lowest and highest fractions of the rated voltage: 9.0 to 15.0 V for a 12 V servo."""
HIGH_SHARE: Final = 1.15
"""Fraction of the rated voltage above which a supply is unusual. A full battery reaches a fraction of 1.14 (8.4 V for a
7.4 V servo).
"""
_SMALL_STS: Final = (4.4, 8.9)
"""Voltage range of small STS models, in V. Their datasheet range starts at 4 V, and many arms with 7.4 V servos use a 5
V supply."""
RANGES_V: Final = {
    **dict.fromkeys(("sts3215_c001", "sts3215_c044", "sts3215_c046"), _SMALL_STS),
    **dict.fromkeys(("scs15", "xl320"), (5.5, 8.9)),
    **dict.fromkeys(("xl330-m077", "xl330-m288", "xc330-m181", "xc330-m288"), (3.7, 6.0)),
    **dict.fromkeys(("xl430-w250", "xc430-w150", "xc430-w240", "xc330-t181", "xc330-t288"), (6.5, 15.0)),
    **dict.fromkeys(("2xl430-w250", "2xc430-w250", "xc335-t332"), (6.5, 15.0)),
    **dict.fromkeys(("rx-28", "rx-64", "ex-106+"), (12.0, 19.0)),
}
"""Lowest and highest voltage by model, in V, for models whose datasheets differ from the usual fractions."""


class VoltageFault(NamedTuple):
    """Supply voltage fault of one servo."""

    kind: Literal["over-voltage", "under-voltage", "high supply", "low supply"]
    text: str
    """Message, worded to follow the servo's name."""

    @property
    def outside(self) -> bool:
        """Whether the voltage is outside the rated range, in which case torque must not be enabled."""
        return self.kind in ("over-voltage", "under-voltage")


def voltage_range(model: ServoModel) -> tuple[float, float]:
    """Return the lowest and the highest rated voltage of a model, in V."""
    rated = model.rated_voltage_v
    return model.supply_v or RANGES_V.get(model.name, (LOWEST_SHARE * rated, HIGHEST_SHARE * rated))


def usual_range(model: ServoModel) -> tuple[float, float]:
    """Return the lowest and the highest usual voltage of a model, in V. The usual range is within the rated range."""
    (lowest, highest), rated = voltage_range(model), model.rated_voltage_v
    return max(lowest, LOWEST_SHARE * rated), min(highest, HIGH_SHARE * rated)


def voltage_fault(model: ServoModel, voltage_v: float) -> VoltageFault | None:
    """Return the fault for a voltage in V, or None if there is none. A voltage of 0 means that the servo does not
    measure it."""
    (lowest, highest), (low, high), rated = voltage_range(model), usual_range(model), model.rated_voltage_v
    if voltage_v <= 0.0 or low <= voltage_v <= high:
        return None
    made = f"has {voltage_v:.1f} V, but an {model.name} is rated for {rated:g} V ({lowest:.1f} to {highest:.1f} V)"
    other = f"a {rated:g} V supply, or correct the model in the robot file"
    if voltage_v > highest:
        return VoltageFault("over-voltage", f"{made}: switch the supply off now, and connect {other}")
    if voltage_v < lowest:
        return VoltageFault("under-voltage", f"{made}: check the supply and its cables, and connect {other}")
    if voltage_v > high:
        return VoltageFault("high supply", f"{made}: check the supply")
    return VoltageFault("low supply", f"{made}: torque and speed are lower than the datasheet states")
