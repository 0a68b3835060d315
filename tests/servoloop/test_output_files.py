"""Files that a command writes: the name of an input file or of any other file is refused, and its content is kept."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from shutil import copytree

import pytest

from servoloop.commands.up import announced, check_ready_file
from servoloop.stack.shipped_files import ARMS
from tests.complaint import complaint
from tests.servoloop.served import eventually


@pytest.mark.parametrize(
    ("line", "kept", "says"),
    [
        ("plot v.mcap --out v.mcap", "v.mcap", "v.mcap does not end in .html: choose such a name"),
        ("plot v.html", "v.html", "v.html is the file that this command reads: choose another file"),
        ("arms show ./arm --out arm/robot.yaml", "arm/robot.yaml", "arm/robot.yaml does not end in .png"),
        ("tune joint1 --out v.mcap --port none", "v.mcap", "v.mcap does not end in .svg"),
        ("bench arm --out v.mcap --port none", "v.mcap", "v.mcap does not end in .html"),
        ("doctor --report v.mcap --port none", "v.mcap", "v.mcap does not end in .md"),
        ("camera show v.png --out v.png", "v.png", "v.png is the file that this command reads"),
        ("camera show 77 --out v.mcap", "v.mcap", "v.mcap does not end in .png or .jpg or .jpeg"),
        ("camera calibrate 77 --out v.mcap", "v.mcap", "v.mcap does not end in .yaml or .yml"),
        ("up --hardware mock --no-ros --ready-file v.mcap", "v.mcap", "v.mcap exists and is not a ready file"),
        ("topic-host --hardware mock --ready-file v.mcap", "v.mcap", "v.mcap exists and is not a ready file"),
    ],
)
def test_an_output_that_would_replace_another_file_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    line: str,
    kept: str,
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    copytree(ARMS / "so101", "arm")
    for name in ("v.mcap", "v.html", "v.png"):
        Path(name).write_text("12 important bytes")
    before = Path(kept).read_bytes()
    said = complaint(capsys, monkeypatch, *line.split())
    assert says in said and said.count("\n") == 1
    assert Path(kept).read_bytes() == before


@pytest.mark.parametrize("content", ["", "123\n", "123"])
def test_the_ready_file_of_an_earlier_run_is_removed_at_the_start(tmp_path: Path, content: str) -> None:
    ready = tmp_path / "ready"
    ready.write_text(content)
    check_ready_file(ready)
    assert not ready.exists()


def test_the_ready_file_is_removed_at_the_end_unless_another_process_wrote_it(tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    with announced(ready) as report:
        report("arm")
        assert ready.read_text() == f"{os.getpid()}\n"
    assert not ready.exists()
    with announced(ready) as report:
        report("arm")
        ready.write_text("1\n")
    assert ready.read_text() == "1\n"


def test_up_removes_its_ready_file_when_it_ends(tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    command = [sys.executable, "-m", "servoloop", "up", "--hardware", "mock", "--no-ros", "--ready-file", str(ready)]
    with subprocess.Popen(command, env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)}) as process:
        eventually(lambda: ready.exists() or process.poll() is not None, 60.0)
        assert ready.exists()
        process.send_signal(signal.SIGINT)
    assert not ready.exists()
