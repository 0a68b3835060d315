"""Draw controller switches and speed scaling factors."""

from random import Random
from typing import Final

from servoloop.simulation.acts import Act, Reactivate, ScaleSpeed, Switch

FACTORS: Final = (2.0, 1.0, 3.0)
"""Relative frequencies of a speed scaling factor of 1, a factor of 0, and a factor between 0 and 1."""
IMPOSSIBLE: Final = 0.3
"""Fraction of the controller switches that are impossible."""


def draw_handover(random: Random, at_s: float) -> Act:
    """Draw a deactivation of the arm's controller or of the hardware, and a later activation."""
    for_s = round(random.uniform(0.05, 1.0), 2)
    if random.random() < 0.5:
        return Switch(at_s=at_s, for_s=for_s, impossible=random.random() < IMPOSSIBLE)
    for_s, relax = random.choice([(for_s, False), (for_s, True), (0.0, False), (0.0, False)])
    return Reactivate(at_s=at_s, for_s=for_s, relax=relax, push=draw_share(random))


def draw_speed(random: Random, at_s: float) -> ScaleSpeed:
    """Draw a new speed scaling factor."""
    factor = random.choices([1.0, 0.0, round(random.uniform(0.05, 1.0), 2)], FACTORS)[0]
    return ScaleSpeed(at_s=at_s, factor=factor)


def draw_share(random: Random) -> float:
    """Draw a fraction from 0.2 to 1 with either sign."""
    return round(random.choice([-1.0, 1.0]) * random.uniform(0.2, 1.0), 2)
