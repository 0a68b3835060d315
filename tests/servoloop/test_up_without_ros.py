"""``servoloop up`` without rclpy and with ``--no-ros``: the stack runs and reports once that ROS is missing."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from drivers.clock import MonotonicClock
from servoloop.recording.sources import LiveSource
from servoloop.recording.stream import find_stack
from tests.live.rig import runtime_folder
from tests.servoloop.served import eventually
from tests.servoloop.up_process import running_up

pytestmark = pytest.mark.slow

HIDDEN = "import sys\nsys.modules['rclpy'] = None\n"
"""Start-up file of Python that hides rclpy."""
ONCE = "the stack runs without ROS"


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
    options = ("--hardware", "mock", *arguments, "--record", str(recording))
    with runtime_folder(monkeypatch), running_up(tmp_path, *options) as process:
        source = LiveSource(str(find_stack().pid), MonotonicClock())
        try:
            assert source.has_state.wait(20.0)
            eventually(lambda: source.robot.state.snapshot.cycles > 5)
        finally:
            source.close()
    text = (tmp_path / "up.log").read_text()
    assert process.returncode == 0, text
    assert text.count(ONCE) == 1 and reason in text and "Traceback" not in text
    assert recording.stat().st_size > 1000
