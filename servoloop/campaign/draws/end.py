"""Draw how a run ends: with one signal, or with a second signal while the arm parks."""

from random import Random
from typing import Final

HURRIES: Final = 0.15
"""Fraction of the runs that release the arm in which a second signal arrives while the arm parks."""
HURRIES_S: Final = (0.0, 1.5)
"""Range of the time from the first to the second signal, in seconds."""


def draw_hurry(seed: int) -> float | None:
    """Return the time from the first to the second signal in seconds, or None if there is no second signal.

    Args:
        seed: Seed of the run.
    """
    random = Random(f"{seed}/hurry")
    return round(random.uniform(*HURRIES_S), 3) if random.random() < HURRIES else None
