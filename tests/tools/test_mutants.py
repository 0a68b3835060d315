"""Tests that ``make mutants`` finds its files and can run its tests."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
AREAS = runpy.run_path(str(ROOT / "tools" / "mutants.py"))["AREAS"]


@pytest.mark.parametrize("name", AREAS)
def test_the_files_and_tests_of_every_area_exist(name: str) -> None:
    for pattern in (*AREAS[name].files, *AREAS[name].tests):
        assert list(ROOT.glob(pattern)), f"{pattern}: correct AREAS in tools/mutants.py"


def test_tests_run_without_xdist_as_for_mutants() -> None:
    command = (sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:xdist", "--collect-only", __file__)
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60.0, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
