"""Machine code is compiled again after a change of any source in its folder."""

from pathlib import Path
from typing import Any

import numba
import pytest

from planning.clearance.compiled import compiled, remove_stale


def test_machine_code_is_kept_until_a_source_changes(tmp_path: Path) -> None:
    source, index = tmp_path / "called.py", tmp_path / "__pycache__" / "caller.f-1.py311.nbi"
    source.write_text("def called(): return 1\n")
    remove_stale(tmp_path)
    index.write_bytes(b"machine code")
    remove_stale(tmp_path)
    assert index.exists()
    source.write_text("def called(): return 2\n")
    remove_stale(tmp_path)
    assert not index.exists()


def test_without_a_folder_for_the_cache_functions_are_compiled_in_every_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def njit(*, cache: bool, **options: Any) -> Any:
        if cache:
            raise RuntimeError("cannot cache function 'called': no locator available")
        return lambda function: function

    monkeypatch.setattr(numba, "njit", njit)
    assert compiled(lambda: 1)() == 1
