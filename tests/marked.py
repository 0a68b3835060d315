"""Which tests carry which marks.

A run that has collected the files in question knows it; else pytest collects them in a process of its own, with this
module as its plug-in.
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
"""The marks, each with one without which it does not count."""
Marked = dict[str, list[str]]
"""The tests by each argument of their marks."""
_FOUND = pytest.StashKey[dict[str, Marked]]()
_FILES = pytest.StashKey[set[Path]]()


def remember(config: pytest.Config, items: Sequence[pytest.Item]) -> None:
    """Remember the marks of all tests that were collected, before some are left out."""
    config.stash[_FILES] = {item.path for item in items}
    config.stash[_FOUND] = {name: _by_argument(items, name) for name in NAMES}


def marked(config: pytest.Config, name: str, files: Sequence[Path]) -> Marked:
    """The tests in these files by each argument of their marks of this name."""
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
    """Write them down, where this is the plug-in."""
    if "MARKED" in os.environ:
        Path(os.environ["MARKED"]).write_text(json.dumps(session.config.stash[_FOUND]))
