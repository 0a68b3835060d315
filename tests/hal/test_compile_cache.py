"""Compiled functions work even if their machine code can be neither stored nor loaded."""

import errno
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from numba.core import config
from numba.core.caching import IndexDataCacheFile

from hal import compile_cache
from planning.clearance import compiled as planner
from sim_backend import compiled as simulation

FULL = OSError(errno.ENOSPC, "No space left on device")
SOURCE = "def plus(x):\n    return x + {added}\n"


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """Return the folder of the cache. Each test reports a problem of the cache again."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    compile_cache._report_no_cache.cache_clear()
    yield tmp_path / "cache"
    compile_cache._report_no_cache.cache_clear()


def plus(folder: Path, added: float) -> Callable[[float], float]:
    """Return a function from a source file, as a new process imports it."""
    path = folder.parent / "plus.py"
    path.write_text(SOURCE.format(added=added))
    scope: dict[str, Any] = {}
    exec(compile(path.read_text(), path, "exec"), scope)
    function: Callable[[float], float] = scope["plus"]
    return function


def failing(*_: object) -> None:
    raise FULL


@pytest.mark.parametrize("compiled", [planner.compiled, simulation.compiled], ids=["planner", "simulation"])
@pytest.mark.parametrize("method", ["_save_index", "_save_data", "_load_index"])
def test_a_function_runs_if_the_disk_of_the_cache_fails(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, compiled: Any, method: str
) -> None:
    monkeypatch.setattr(IndexDataCacheFile, method, failing)
    with caplog.at_level(logging.WARNING):
        assert [compiled(plus(folder, 1.0))(1.0), compiled(plus(folder, 2.0))(1.0)] == [2.0, 3.0]
    assert caplog.messages == [
        "the cache of compiled functions cannot be used (No space left on device), so every start takes longer: set "
        "NUMBA_CACHE_DIR to a writable folder with free space"
    ]


def test_old_machine_code_is_not_used_after_new_code_could_not_be_stored(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numba stores the index, which names the source, before the machine code. Both have the names of the old files."""
    assert simulation.compiled(plus(folder, 1.0))(1.0) == 2.0
    with monkeypatch.context() as patch:
        patch.setattr(IndexDataCacheFile, "_save_data", failing)
        assert simulation.compiled(plus(folder, 2.5))(1.0) == 3.5
    assert simulation.compiled(plus(folder, 2.5))(1.0) == 3.5


def test_machine_code_is_loaded_from_the_cache(folder: Path) -> None:
    for hits in (0, 1):
        function: Any = simulation.compiled(plus(folder, 1.0))
        assert function(1.0) == 2.0 and sum(function.stats.cache_hits.values()) == hits
    assert function.stats.cache_path.startswith(str(folder))


def test_functions_stay_in_python_if_compilation_is_disabled(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(config, "DISABLE_JIT", True)
    assert simulation.compiled(plus(folder, 1.0))(1.0) == 2.0
