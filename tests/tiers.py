"""Select tests: `make test` runs the quick tests, CI also runs a part of the slow tests, and `make test-all` runs all
tests.

`make test` runs only the first case of a long test (long_tests.txt).
"""

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Final

import pytest

LIST = Path(__file__).with_name("long_tests.txt")
ALWAYS: Final = "tests/ros/test_readme.py"
"""File with the commands of the README, from which CI always runs one test."""


@cache
def long_tests() -> frozenset[str]:
    """Return the names of the long tests, without their cases."""
    lines = LIST.read_text().splitlines()
    return frozenset(line for line in lines if line and not line.startswith("#"))


def has_long_tests(path: Path) -> bool:
    """Return whether a file has a long test."""
    return any(path.match(name.partition("::")[0]) for name in long_tests())


def mark_long(items: Iterable[pytest.Item]) -> None:
    """Mark the cases of long tests as slow, except for the first case."""
    seen: set[str] = set()
    for item in items:
        name, _, case = item.nodeid.partition("[")
        if name in long_tests() and (not case or name in seen):
            item.add_marker(pytest.mark.slow)
        seen.add(name)


def sample(items: list[pytest.Item]) -> list[pytest.Item]:
    """Return the first test of each folder, and the first test of ``ALWAYS``.

    Tests in ``long_tests`` are omitted, because `make test` runs their first case, or because they take too long.
    """
    first: dict[Path, pytest.Item] = {}
    for item in items:
        if item.nodeid.partition("[")[0] not in long_tests():
            first.setdefault(item.path if item.path.match(ALWAYS) else item.path.parent, item)
    return list(first.values())
