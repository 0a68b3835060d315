"""Which tests run when: `make test` has the quick ones, CI a part of the slow ones too, `make test-all` all.

Of a long test (long_tests.txt) `make test` has the first of several cases.
"""

from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

LIST = Path(__file__).with_name("long_tests.txt")


@cache
def long_tests() -> frozenset[str]:
    """The long tests, without their cases."""
    lines = LIST.read_text().splitlines()
    return frozenset(line for line in lines if line and not line.startswith("#"))


def has_long_tests(path: Path) -> bool:
    """Whether a file has a long test."""
    return any(path.match(name.partition("::")[0]) for name in long_tests())


def mark_long(items: Iterable[pytest.Item]) -> None:
    """Mark the cases of long tests as slow, except the first of several."""
    seen: set[str] = set()
    for item in items:
        name, _, case = item.nodeid.partition("[")
        if name in long_tests() and (not case or name in seen):
            item.add_marker(pytest.mark.slow)
        seen.add(name)


def first_of_each_file(items: list[pytest.Item]) -> list[pytest.Item]:
    """The first test of each file, in order; without long tests, of which `make test` has a case."""
    slow = [item for item in items if item.nodeid.partition("[")[0] not in long_tests()]
    return list({item.path: item for item in reversed(slow)}.values())[::-1]
