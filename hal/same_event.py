"""Texts of one event: they differ in their figures alone, and together they are one text."""

import re
from collections.abc import Sequence
from typing import Final

_FIGURE: Final = re.compile(r"(?<![\w.-])[+-]?\d+(?:\.\d+)?(?!\w|\.\d)")
"""A number that stands for itself. The digits in the name of a model or a port are none."""


def event_of(text: str) -> tuple[str, ...]:
    """Return what a text has in common with the other texts of its event: everything except its figures."""
    return tuple(_FIGURE.split(text))


def as_one(texts: Sequence[str]) -> str:
    """Return one text of all texts of an event, with the range of each figure that differs.

    ``has 4.1 V`` and ``has 4.3 V`` become ``has 4.1 to 4.3 V``.
    """
    between = event_of(texts[0])
    figures = [_range(column) for column in zip(*map(_FIGURE.findall, texts), strict=True)]
    return "".join(part for pair in zip(between, [*figures, ""], strict=True) for part in pair)


def _range(figures: Sequence[str]) -> str:
    lowest, highest = min(figures, key=float), max(figures, key=float)
    return lowest if float(lowest) == float(highest) else f"{lowest} to {highest}"
