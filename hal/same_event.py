"""Merge messages about the same event, which differ only in their numbers, into one message."""

import re
from collections.abc import Sequence
from typing import Final

_FIGURE: Final = re.compile(r"(?<![\w.-])[+-]?\d+(?:\.\d+)?(?!\w|\.\d)")
"""Pattern for a number that stands alone. Digits within a model or port name do not match."""


def event_of(text: str) -> tuple[str, ...]:
    """Return the parts of a message between its numbers. Messages whose other parts are equal belong to the same
    event."""
    return tuple(_FIGURE.split(text))


def as_one(texts: Sequence[str]) -> str:
    """Merge all messages about an event into one, with a range for each number that differs.

    For example, ``has 4.1 V`` and ``has 4.3 V`` become ``has 4.1 to 4.3 V``.
    """
    between = event_of(texts[0])
    figures = [_range(column) for column in zip(*map(_FIGURE.findall, texts), strict=True)]
    return "".join(part for pair in zip(between, [*figures, ""], strict=True) for part in pair)


def _range(figures: Sequence[str]) -> str:
    lowest, highest = min(figures, key=float), max(figures, key=float)
    return lowest if float(lowest) == float(highest) else f"{lowest} to {highest}"
