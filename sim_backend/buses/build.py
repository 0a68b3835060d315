"""Options of one virtual arm: gear backlash, and deviations of its components from their nominal values."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import radians
from typing import Final

from sim_backend.buses.mounting import Mounting
from sim_backend.line.spread import Spread
from sim_backend.mechanics.plant import Coupling


@dataclass(frozen=True, slots=True)
class Build:
    """Options of one virtual arm."""

    backlash_deg: float = 0.0
    """Angle by which each servo's shaft can move without moving its motor, in degrees."""
    seed: int | None = None
    """Random seed for the arm's friction, motors, masses and supply; None for nominal values."""
    practice_seed: int | None = None
    """Random seed for the servo zeros and directions; None to use those of the robot file.

    With this seed, an emulator places no stand, bins or cube on the table, because the arm must be calibrated first."""
    in_box: bool = False
    """Whether the servos are factory-new: all have the same ID, and none is connected (``sim_backend.box``)."""

    apples: int | None = None
    """Random seed for the apples that replace the cube; None to use the cube."""

    @property
    def spread(self) -> Spread:
        """Deviations of the arm's components."""
        return Spread(self.seed)

    def mounted(self, designed: Sequence[Coupling]) -> list[Coupling]:
        """Return the couplings of the arm as it was assembled."""
        return list(designed) if self.practice_seed is None else Mounting(self.practice_seed).couplings(designed)

    def gaps(self, couplings: Iterable[Coupling]) -> dict[str, float]:
        """Return the backlash in rad or m, keyed by joint name; empty if there is no backlash."""
        gap_rad = radians(self.backlash_deg)
        return {one.joint: gap_rad * one.transmission for one in couplings} if gap_rad else {}


NOMINAL_BUILD: Final = Build()
"""Options of a nominal arm, whose servos match their data sheets."""
