"""Assembly of an arm: the angle of each servo's horn, and the direction in which the servo's shaft turns the joint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.mechanics.plant import Coupling


@dataclass(frozen=True, slots=True)
class Mounting:
    """One random assembly of an arm, with arbitrary zeros and directions. The assembly depends only on ``seed``."""

    seed: int

    def couplings(self, designed: Sequence[Coupling]) -> list[Coupling]:
        """Return the couplings of an arm whose servos were mounted without alignment."""
        random = np.random.default_rng(self.seed)
        return [
            replace(
                one,
                zero_counts=int(random.integers(0, one.counts_per_turn)),
                sign=int(random.choice((-1, 1))),
            )
            for one in designed
        ]
