"""How an arm was put together: where each servo's horn sits, and which way its shaft turns the joint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.mechanics.plant import Coupling


@dataclass(frozen=True, slots=True)
class Mounting:
    """One way of putting an arm together, the same for the same ``seed``: any zero, either direction."""

    seed: int

    def couplings(self, designed: Sequence[Coupling]) -> list[Coupling]:
        """The couplings of an arm whose servos nobody aligned."""
        random = np.random.default_rng(self.seed)
        return [
            replace(
                one,
                zero_counts=int(random.integers(0, one.counts_per_turn)),
                sign=int(random.choice((-1, 1))),
            )
            for one in designed
        ]
