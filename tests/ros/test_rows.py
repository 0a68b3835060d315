"""Every row that clients count on has a test over DDS, and every mark names a row."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros.rows import ROWS

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def tests_of(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """The tests of each row, of those that talk over a real middleware."""
    marked = tmp_path_factory.mktemp("rows") / "marked.json"
    collect = [
        sys.executable,
        "-m",
        "pytest",
        "--collect-only",
        "-q",
        "-m",
        "ros",
        "-p",
        "tests.ros.marked",
        "tests/ros",
    ]
    subprocess.run(collect, cwd=ROOT, env={**os.environ, "MARKED": str(marked)}, check=True, capture_output=True)
    marks: dict[str, list[str]] = json.loads(marked.read_text())
    return marks


def test_every_row_has_a_test(tests_of: dict[str, list[str]]) -> None:
    assert [f"{row}: {says}" for row, says in ROWS.items() if row not in tests_of] == []


def test_every_mark_names_a_row(tests_of: dict[str, list[str]]) -> None:
    assert {row: tests for row, tests in tests_of.items() if row not in ROWS} == {}
