"""Tests that the files and tests listed for ``make mutants`` exist."""

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
AREAS = runpy.run_path(str(ROOT / "tools" / "mutants.py"))["AREAS"]


@pytest.mark.parametrize("name", AREAS)
def test_the_files_and_tests_of_every_area_exist(name: str) -> None:
    for pattern in (*AREAS[name].files, *AREAS[name].tests):
        assert list(ROOT.glob(pattern)), f"{pattern}: correct AREAS in tools/mutants.py"
