"""Stopwatch for parts of a program that call one another."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class Stopwatch:
    """Time spent in each part, in seconds, excluding time spent in other parts that it calls."""

    spent_s: dict[str, float] = field(default_factory=dict)
    _inner_s: list[float] = field(default_factory=lambda: [0.0])

    def watch(self, part: str, owner: object, *methods: str) -> None:
        """From now on, add the time spent in these methods of ``owner`` to this part."""
        for method in methods:
            setattr(owner, method, self.timed(part, getattr(owner, method)))

    def timed(self, part: str, method: Callable[..., Any]) -> Callable[..., Any]:
        """Return a wrapper that calls ``method`` and adds its execution time to this part."""
        self.spent_s.setdefault(part, 0.0)

        def timed(*args: Any, **kwargs: Any) -> Any:
            self._inner_s.append(0.0)
            begin_s = time.perf_counter()
            try:
                return method(*args, **kwargs)
            finally:
                whole_s = time.perf_counter() - begin_s
                self.spent_s[part] += whole_s - self._inner_s.pop()
                self._inner_s[-1] += whole_s

        return timed

    def shares(self) -> dict[str, float]:
        """Return each part's fraction of the total time."""
        total_s = sum(self.spent_s.values())
        return {part: spent_s / total_s for part, spent_s in self.spent_s.items()}
