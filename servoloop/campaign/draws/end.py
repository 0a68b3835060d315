"""Draw when and how a run ends: with one signal, or with a second signal while the arm parks."""

from random import Random
from typing import Final

HURRIES: Final = 0.15
"""Fraction of the runs that release the arm in which a second signal arrives while the arm parks."""
HURRIES_S: Final = (0.0, 1.5)
"""Range of the time from the first to the second signal, in seconds."""
ENDS_EARLY: Final = 0.25
"""Fraction of runs that end in the middle of the actions and faults, as if the user stopped the program."""
EARLIEST_S: Final = 1.0
"""Earliest time at which such a run ends, in seconds."""


def draw_end(seed: int, within_s: float) -> float:
    """Return the time at which a run ends in the middle of its actions and faults, or else ``within_s``, in seconds.

    Args:
        seed: Seed of the run.
        within_s: Time within which actions and faults begin, in seconds.
    """
    random = Random(f"{seed}/end")
    if random.random() >= ENDS_EARLY:
        return within_s
    return round(random.uniform(min(EARLIEST_S, within_s), within_s), 3)


def draw_hurry(seed: int) -> float | None:
    """Return the time from the first to the second signal in seconds, or None if there is no second signal.

    Args:
        seed: Seed of the run.
    """
    random = Random(f"{seed}/hurry")
    return round(random.uniform(*HURRIES_S), 3) if random.random() < HURRIES else None
