"""Registry of the bugs that tests plant in the stack."""

from collections.abc import Callable, Iterator
from itertools import count
from typing import Final
from weakref import WeakKeyDictionary

import pytest

Plant = Callable[[pytest.MonkeyPatch], None]

BUGS: Final[dict[str, tuple[Plant, frozenset[str]]]] = {}


def detected_by(*invariants: str) -> Callable[[Plant], Plant]:
    """Register a bug with the invariants that may detect it."""

    def register(plant: Plant) -> Plant:
        BUGS[plant.__name__] = plant, frozenset(invariants)
        return plant

    return register


def calls() -> Callable[[object], int]:
    """Return a function that counts the calls with each object, so that a bug does not depend on earlier runs."""
    counts: WeakKeyDictionary[object, Iterator[int]] = WeakKeyDictionary()
    return lambda owner: next(counts.setdefault(owner, count(1)))
