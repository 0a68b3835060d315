"""Log-uniform numbers for drawn faults: each factor of ten is as likely as any other, so no extreme value is rare."""

from random import Random


def log_uniform(random: Random, lowest: float, highest: float) -> float:
    """A number from ``lowest`` to ``highest``, to three digits."""
    drawn = lowest * (highest / lowest) ** random.random()
    return min(max(float(f"{drawn:.3g}"), lowest), highest)


def about(random: Random, usual: float, factor: float) -> float:
    """A number from ``usual`` divided by ``factor`` to ``usual`` times ``factor``, to three digits."""
    return log_uniform(random, usual / factor, usual * factor)


def either_way(random: Random, value: float) -> float:
    """``value``, or its negative."""
    return random.choice((-1, 1)) * value
