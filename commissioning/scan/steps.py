"""Steps of a scan: combinations of baud rate and protocol, with the most likely combinations first."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from types import ModuleType
from typing import Final

from drivers.protocol import v1, v2
from drivers.servos import sts, x
from drivers.servos.catalog import Make

DYNAMIXEL_1_RATES: Final = (
    *(1_000_000, 57_600, 115_200, 500_000, 400_000, 250_000, 200_000, 19_200, 9_600),
    *(2_250_000, 2_500_000, 3_000_000),
)
"""Nominal baud rates of Dynamixel protocol 1.0, including those that only MX servos support."""

RATES: Final[dict[tuple[Make, ModuleType], tuple[int, ...]]] = {
    ("feetech", v1): sts.BAUD_RATES,
    ("dynamixel", v2): x.BAUD_RATES,
    ("dynamixel", v1): DYNAMIXEL_1_RATES,
}
_LIKELY: Final = ((v1, 1_000_000), (v2, 57_600), (v2, 1_000_000), (v1, 57_600), (v1, 115_200), (v1, 500_000))
"""Most likely protocols and baud rates: the factory settings of Feetech and ROBOTIS, and common settings of arms."""


@dataclass(frozen=True, slots=True)
class ScanStep:
    """One baud rate and one protocol; ``packets`` is ``drivers.protocol.v1`` or ``v2``."""

    packets: ModuleType
    baud: int

    @property
    def servos(self) -> str:
        """Types of servos that use this protocol."""
        return "Feetech, Dynamixel protocol 1.0" if self.packets is v1 else "Dynamixel protocol 2.0"

    @property
    def text(self) -> str:
        """Label for a progress bar."""
        return f"{self.baud} baud, {self.servos}"


def steps(makes: Collection[Make] = (), bauds: Iterable[int] = ()) -> tuple[ScanStep, ...]:
    """Return all steps for these makes and baud rates. Empty arguments select all makes and all of their baud rates."""
    wanted = tuple(bauds)
    found = {
        ScanStep(packets, baud)
        for (make, packets), rates in RATES.items()
        if not makes or make in makes
        for baud in wanted or rates
    }
    return tuple(sorted(found, key=_place))


def _place(step: ScanStep) -> tuple[int, bool, int]:
    key = (step.packets, step.baud)
    return _LIKELY.index(key) if key in _LIKELY else len(_LIKELY), step.packets is v2, -step.baud
