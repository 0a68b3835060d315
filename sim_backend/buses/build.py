"""How one virtual arm is built: its gears' backlash, and how its parts differ from the nominal ones."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import radians
from typing import Final

from sim_backend.buses.mounting import Mounting
from sim_backend.line.spread import Spread
from sim_backend.mechanics.plant import Coupling


@dataclass(frozen=True, slots=True)
class Build:
    """One virtual arm of many."""

    backlash_deg: float = 0.0
    """By so much the shaft of each servo is free of its motor."""
    seed: int | None = None
    """Gives the arm friction, motors, masses and a supply of its own. None: the nominal ones."""
    practice_seed: int | None = None
    """Gives it zeros and directions that nobody has calibrated, on an empty table. None: those of the robot file."""
    in_box: bool = False
    """Its servos are as they come from the factory, all with one ID and none connected (``sim_backend.box``)."""

    @property
    def spread(self) -> Spread:
        """The arm's parts."""
        return Spread(self.seed)

    def mounted(self, designed: Sequence[Coupling]) -> list[Coupling]:
        """The couplings of the arm as it was put together."""
        return list(designed) if self.practice_seed is None else Mounting(self.practice_seed).couplings(designed)

    def gaps(self, couplings: Iterable[Coupling]) -> dict[str, float]:
        """The backlash by joint, rad or m; empty where there is none."""
        gap_rad = radians(self.backlash_deg)
        return {one.joint: gap_rad * one.transmission for one in couplings} if gap_rad else {}


NOMINAL_BUILD: Final = Build()
"""Servos without deviations from their data sheets."""
