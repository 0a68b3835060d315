"""Switches and values that several faults can change at the same time."""

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Any


class Holds:
    """Changes that faults make to shared values.

    The latest change is in effect. After the last change has ended, the usual value is restored.
    """

    def __init__(self) -> None:
        self._held: dict[Hashable, list[list[Any]]] = {}

    @contextmanager
    def hold(self, key: Hashable, apply: Callable[[Any], None], value: Any, usual: Any) -> Iterator[None]:
        """Apply ``value`` while the context is active.

        After the last fault on ``key`` has ended, the value ``usual`` of the first fault is applied.
        """
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
