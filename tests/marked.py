"""Find the tests that have certain marks.

If the run has not collected the files in question, pytest collects them in a separate process with this module as its
plugin.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NAMES = {"row": "ros", "runs": ""}
"""Names of the marks, each with a second mark that a test must also have, if there is one."""
Marked = dict[str, list[str]]
"""Tests, by each argument of their marks."""
_FOUND = pytest.StashKey[dict[str, Marked]]()
_FILES = pytest.StashKey[set[Path]]()


def remember(config: pytest.Config, items: Sequence[pytest.Item]) -> None:
    """Store the marks of all collected tests before some of the tests are deselected."""
    config.stash[_FILES] = {item.path for item in items}
    config.stash[_FOUND] = {name: _by_argument(items, name) for name in NAMES}


def marked(config: pytest.Config, name: str, files: Sequence[Path]) -> Marked:
    """Return the tests in these files that have a mark with this name, by each argument of the mark."""
    if not config.stash[_FILES].issuperset(files):
        return _collected(files)[name]
    within = {str(path.relative_to(ROOT)) for path in files}
    found = {
        argument: [test for test in tests if test.partition("::")[0] in within]
        for argument, tests in config.stash[_FOUND][name].items()
    }
    return {argument: tests for argument, tests in found.items() if tests}


def _by_argument(items: Sequence[pytest.Item], name: str) -> Marked:
    tests: Marked = {}
    for item in items:
        if NAMES[name] and item.get_closest_marker(NAMES[name]) is None:
            continue
        for mark in item.iter_markers(name):
            for argument in mark.args:
                tests.setdefault(argument, []).append(item.nodeid)
    return tests


def _collected(files: Sequence[Path]) -> dict[str, Marked]:
    with tempfile.TemporaryDirectory() as folder:
        found = Path(folder) / "marked.json"
        collect = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "tests.marked", *map(str, files)]
        environment = {**os.environ, "MARKED": str(found)}
        done = subprocess.run(collect, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr
        tests: dict[str, Marked] = json.loads(found.read_text())
    return tests


def pytest_collection_finish(session: pytest.Session) -> None:
    """Write the marks to a file if this module is the plugin."""
    if "MARKED" in os.environ:
        Path(os.environ["MARKED"]).write_text(json.dumps(session.config.stash[_FOUND]))
