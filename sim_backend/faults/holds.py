"""Switches and values that several faults may hold at the same time."""

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Any


class Holds:
    """Of the faults that hold one thing the last to begin counts; when the last has ended it is as it was before."""

    def __init__(self) -> None:
        self._held: dict[Hashable, list[list[Any]]] = {}

    @contextmanager
    def hold(self, key: Hashable, apply: Callable[[Any], None], value: Any, usual: Any) -> Iterator[None]:
        """``apply(value)`` now. ``usual`` is applied when nobody holds ``key`` any more: that of the first to come."""
        values = self._held.setdefault(key, [[usual]])
        mine = [value]
        values.append(mine)
        apply(value)
        try:
            yield
        finally:
            counted = values[-1] is mine
            values[:] = [each for each in values if each is not mine]
            if counted:
                apply(values[-1][0])
            if len(values) == 1:
                del self._held[key]
