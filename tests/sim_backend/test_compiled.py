"""Compilation is announced once, and is not announced if the cache contains all functions."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sim_backend.compiled import COMPILING

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import numba
from sim_backend.compiled import compilation_announced
one = numba.njit(cache=True)(lambda x: x + 1.0)
other = numba.njit(cache=True)(lambda x: x + 2.0)
with compilation_announced(print):
    one(0.0), other(0.0)
"""


def announced(folder: Path) -> list[str]:
    """Return the output of a program whose functions are cached in a folder."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(ROOT)}
    (folder / "program.py").write_text(PROGRAM)
    command = [sys.executable, str(folder / "program.py")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=100.0, check=True)
    return done.stdout.splitlines()


@pytest.mark.slow
def test_the_first_compilation_is_announced_once(tmp_path: Path) -> None:
    assert announced(tmp_path) == [COMPILING]
    assert announced(tmp_path) == []
