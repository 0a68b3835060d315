"""Every row of the specification has a test over ROS, and every mark refers to an existing row."""

from pathlib import Path

import pytest

from tests.marked import marked
from tests.ros.rows import ROWS


@pytest.fixture(scope="module")
def tests_of(request: pytest.FixtureRequest) -> dict[str, list[str]]:
    """Return the tests of each row that use a real middleware."""
    return marked(request.config, "row", sorted(Path(__file__).parent.glob("test_*.py")))


def test_every_row_has_a_test(tests_of: dict[str, list[str]]) -> None:
    assert [f"{row}: {says}" for row, says in ROWS.items() if row not in tests_of] == []


def test_every_mark_names_a_row(tests_of: dict[str, list[str]]) -> None:
    assert {row: tests for row, tests in tests_of.items() if row not in ROWS} == {}
