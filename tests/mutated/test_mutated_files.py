"""Tests that no user file makes a command print a traceback, hang, or refuse the file without its name."""

import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from controller.manager import plugins
from servoloop.stack import hardware_plugins
from tests.mutated.cases import LONGEST_S, good, mutated, quiet, tried
from tests.mutated.readers import KINDS

pytestmark = pytest.mark.slow

FILES = int(os.environ.get("SERVOLOOP_MUTATED_FILES", "150"))
"""Total number of mutated files of all kinds."""
SEED = int(os.environ.get("SERVOLOOP_MUTATION_SEED", "1"))


@pytest.fixture(autouse=True)
def hurry(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Search for plugins of other packages only once instead of for each file, and suppress warnings."""
    for module in (hardware_plugins, plugins):
        monkeypatch.setattr(module, "entry_points", cache(module.entry_points))
    with quiet():
        yield


@pytest.mark.parametrize("kind", KINDS)
def test_the_good_files_are_read(kind: str, tmp_path: Path) -> None:
    for data in good(kind):
        outcome = tried(kind, data, tmp_path / "arm")
        assert not outcome.refused and (not outcome.wrong or outcome.cpu_s > LONGEST_S), outcome


@pytest.mark.parametrize("kind", KINDS)
def test_mutated_files_are_read_or_refused_with_a_sentence(kind: str, tmp_path: Path) -> None:
    wrong: list[str] = []
    for number in range(max(1, FILES // len(KINDS))):
        data = mutated(kind, SEED, number)
        (tmp_path / "case").write_bytes(data)  # keeps the file in case reading it ends the process
        if said := tried(kind, data, tmp_path / "arm").wrong:
            wrong.append(f"{kind}, seed {SEED}, file {number}: {said}")
    assert not wrong, "\n".join(wrong[:20])
