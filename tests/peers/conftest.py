"""Fixture with lines of virtual servos in separate processes."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.peers.waiting import ROOT

Serve = Callable[..., str]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    """Yield the function ``serve(model, *ids)``, which starts a line and returns the path of its port."""
    served: list[subprocess.Popen[str]] = []

    def start(model: str, *servo_ids: int) -> str:
        link = tmp_path / f"line{len(served)}"
        command = [sys.executable, "-m", "tests.peers.served_line", str(link), model, *map(str, servo_ids)]
        served.append(subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True))
        stdout = served[-1].stdout
        assert stdout is not None
        assert stdout.readline() == "ready\n"
        return str(link)

    yield start
    for process in served:
        process.terminate()
    assert [process.wait(20) for process in served] == [0] * len(served)
