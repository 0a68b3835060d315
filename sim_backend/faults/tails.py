"""Log-uniform random numbers for faults. Each power of ten is equally likely, so extreme values are not rare."""

from random import Random


def log_uniform(random: Random, lowest: float, highest: float) -> float:
    """Draw a number from ``lowest`` to ``highest``, rounded to three digits."""
    drawn = lowest * (highest / lowest) ** random.random()
    return min(max(float(f"{drawn:.3g}"), lowest), highest)


def about(random: Random, usual: float, factor: float) -> float:
    """Draw a number from ``usual`` divided by ``factor`` to ``usual`` times ``factor``, rounded to three digits."""
    return log_uniform(random, usual / factor, usual * factor)


def either_way(random: Random, value: float) -> float:
    """Return ``value`` or its negative."""
    return random.choice((-1, 1)) * value
