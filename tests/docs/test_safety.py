"""Tests that every promise in docs/safety.md names existing tests."""

import re

from tests.pages import DOCS, ROOT

ROWS = re.findall(r"^\| (?!promise|---)(.+) \| (.+) \|$", (DOCS / "safety.md").read_text(), re.MULTILINE)


def test_every_promise_names_tests_that_exist() -> None:
    assert len(ROWS) > 15
    for promise, tests in ROWS:
        named = re.findall(r"`(tests/[\w/]+\.py)`", tests)
        assert (named or tests == "the same") and all((ROOT / name).is_file() for name in named), promise
