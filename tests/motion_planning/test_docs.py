"""The code blocks of docs/planning.md run on a virtual arm."""

from pathlib import Path
from typing import Any

import pytest

from tests.pages import codes, named

PAGE = "planning.md"


@pytest.mark.runs(*named(PAGE, "python"))
def test_every_block_runs(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in codes(PAGE, "python"):
        exec(block, names)
    printed = capsys.readouterr().out
    assert "('shelf', 'lamp')" in printed and "Clearance(distance_m=" in printed
