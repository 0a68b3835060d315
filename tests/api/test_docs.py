"""The code blocks of docs/python.md run on a virtual arm."""

import os
from pathlib import Path
from typing import Any

import pytest

import servoloop
from tests.api.loaded_arm import LoadedArm
from tests.pages import DOCS, code, codes, named

PAGE = "python.md"


class VirtualArmOnPort(LoadedArm):
    """Virtual arm in simulated time that replaces an arm on a port."""

    def __init__(self, name: str, port: str) -> None:
        assert (name, port) == ("so101", "/dev/ttyACM0")
        super().__init__()


class ConnectedArm(servoloop.Arm):
    """Arm whose ``connect`` returns a virtual arm instead of the arm of a running stack."""

    @classmethod
    def connect(cls, arm: str | os.PathLike[str] | int | None = None, *, namespace: str | None = None) -> Any:
        return LoadedArm()


@pytest.mark.runs(*named(PAGE, "python"))
def test_every_block_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    first, *blocks = codes(PAGE, "python")
    names: dict[str, Any] = {}
    with monkeypatch.context() as patch:
        patch.setattr(servoloop, "Arm", VirtualArmOnPort, raising=False)
        exec(first, names)
    assert capsys.readouterr().out.endswith(" {}\n")
    names["Arm"] = ConnectedArm
    with LoadedArm() as arm:
        names["arm"] = arm
        for block in blocks:
            exec(block, names)
    assert code(PAGE, "text").strip() == capsys.readouterr().out.splitlines()[-1]
    assert (tmp_path / "moves.mcap").exists()


def test_the_page_names_every_error_and_every_example() -> None:
    text = (DOCS / PAGE).read_text()
    for name in servoloop.__all__:
        assert not name.endswith("Error") or name == "ArmError" or f"| `{name}` |" in text, name
    for path in (DOCS.parent / "examples").glob("*.py"):
        assert f"[{path.name}](../examples/{path.name})" in text
