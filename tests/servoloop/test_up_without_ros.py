"""``servoloop up`` without rclpy and with ``--no-ros``: the stack runs and reports once that ROS is missing."""

import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.clock import MonotonicClock
from servoloop.recording.sources import LiveSource
from servoloop.recording.stream import find_stack
from tests.live.rig import runtime_folder
from tests.servoloop.served import eventually

pytestmark = pytest.mark.slow

HIDDEN = "import sys\nsys.modules['rclpy'] = None\n"
"""Start-up file of Python that hides rclpy."""
ONCE = "the stack runs without ROS"


@contextmanager
def stack(folder: Path, *arguments: str) -> Iterator[Path]:
    """Run ``servoloop up`` until the end of the block, and yield its log."""
    log, ready = folder / "up.log", folder / "ready"
    with log.open("wb") as output:
        command = [sys.executable, "-m", "servoloop", "up", "--hardware", "mock", "--ready-file", str(ready)]
        process = subprocess.Popen([*command, *arguments], stdout=output, stderr=subprocess.STDOUT)
    try:
        eventually(lambda: ready.exists() or process.poll() is not None, 60.0)
        assert process.poll() is None, log.read_text()
        yield log
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 0, log.read_text()


@pytest.mark.runs("servoloop up --no-ros")
@pytest.mark.parametrize(
    ("arguments", "hidden", "reason"),
    [
        ((), True, "because Python cannot find rclpy (run 'make setup'"),
        (("--no-ros",), False, "as --no-ros requests"),
        (("--no-ros", "--rtf", "5"), True, "as --no-ros requests"),
    ],
    ids=["hidden", "unwanted", "simulated"],
)
def test_the_stack_runs_records_and_can_be_watched(
    arguments: Sequence[str], hidden: bool, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if hidden:
        (tmp_path / "sitecustomize.py").write_text(HIDDEN)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    recording = tmp_path / "run.mcap"
    with runtime_folder(monkeypatch), stack(tmp_path, *arguments, "--record", str(recording)) as log:
        source = LiveSource(str(find_stack().pid), MonotonicClock())
        try:
            assert source.has_state.wait(20.0)
            eventually(lambda: source.robot.state.snapshot.cycles > 5)
        finally:
            source.close()
    text = log.read_text()
    assert text.count(ONCE) == 1 and reason in text and "Traceback" not in text
    assert recording.stat().st_size > 1000
