"""The rated supply of each servo model, and the limits outside which a voltage is reported."""

from typing import Final, Literal, NamedTuple

from drivers.servos.register import ServoModel

LOWEST_SHARE: Final = 0.75
HIGHEST_SHARE: Final = 1.25
"""Of the rated voltage: 9.0 to 15.0 V for a servo of 12 V."""
HIGH_SHARE: Final = 1.15
"""A supply above this share is odd. A full battery has 1.14 of it (8.4 V of 7.4 V); within 10 % a supply is good."""
_SMALL_STS: Final = (4.4, 8.9)
"""The data sheet begins at 4 V, and arms with servos of 7.4 V are often fed with 5 V."""
RANGES_V: Final = {
    **dict.fromkeys(("sts3215_c001", "sts3215_c044", "sts3215_c046"), _SMALL_STS),
    **dict.fromkeys(("scs15", "xl320"), (5.5, 8.9)),
    **dict.fromkeys(("xl330-m077", "xl330-m288", "xc330-m181", "xc330-m288"), (3.7, 6.0)),
    **dict.fromkeys(("xl430-w250", "xc430-w150", "xc430-w240", "xc330-t181", "xc330-t288"), (6.5, 15.0)),
}
"""Lowest and highest voltage by model, where data sheets differ from the shares."""


class VoltageFault(NamedTuple):
    """What is wrong with the supply of one servo."""

    kind: Literal["over-voltage", "under-voltage", "high supply", "low supply"]
    text: str
    """For people, to be put behind the servo's name."""

    @property
    def outside(self) -> bool:
        """Whether the voltage is outside the model's rated range: such a servo must not get torque."""
        return self.kind in ("over-voltage", "under-voltage")


def voltage_range(model: ServoModel) -> tuple[float, float]:
    """Lowest and highest voltage that the model is rated for, in V."""
    rated = model.rated_voltage_v
    return RANGES_V.get(model.name, (LOWEST_SHARE * rated, HIGHEST_SHARE * rated))


def usual_range(model: ServoModel) -> tuple[float, float]:
    """Lowest and highest voltage of a right supply for the model, in V: part of the range that it is rated for."""
    (lowest, highest), rated = voltage_range(model), model.rated_voltage_v
    return max(lowest, LOWEST_SHARE * rated), min(highest, HIGH_SHARE * rated)


def voltage_fault(model: ServoModel, voltage_v: float) -> VoltageFault | None:
    """What is wrong with this voltage, in V. 0 is a servo that does not measure it."""
    (lowest, highest), (low, high), rated = voltage_range(model), usual_range(model), model.rated_voltage_v
    if voltage_v <= 0.0 or low <= voltage_v <= high:
        return None
    made = f"has {voltage_v:.1f} V, and a {model.name} is made for {rated:g} V ({lowest:.1f} to {highest:.1f} V)"
    other = f"a supply of {rated:g} V, or correct the model in the robot file"
    if voltage_v > highest:
        return VoltageFault("over-voltage", f"{made}: switch the supply off now and connect {other}")
    if voltage_v < lowest:
        return VoltageFault("under-voltage", f"{made}: check the supply and its leads, connect {other}")
    if voltage_v > high:
        return VoltageFault("high supply", f"{made}: check the supply")
    return VoltageFault("low supply", f"{made}: it has less torque and speed than its data sheet says")
