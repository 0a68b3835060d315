"""After a job that failed, the demo's next one begins with the arm at home, the hand open and a cube on the stand."""

import io
import os
import signal
import threading
from pathlib import Path

import pytest
from rich.console import Console

pytest.importorskip("rclpy")

from servoloop.arms.folder import find_arm
from servoloop.demo.cell import cell
from servoloop.demo.live import Live
from sim_backend.mechanics.build import Build

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SILENCE_S = 3.0


class StopsEmulator(Live):
    """Stops the servos' side for seconds in one phase of the first job."""

    def __init__(self, console: Console, phase: str) -> None:
        super().__init__(console)
        self.emulator = 0
        self._when = phase

    def phase(self, phase: str, message: str) -> None:
        super().phase(phase, message)
        if phase == self._when:
            self._when = ""
            os.kill(self.emulator, signal.SIGSTOP)
            threading.Timer(SILENCE_S, os.kill, (self.emulator, signal.SIGCONT)).start()


@pytest.mark.parametrize("phase", ["grasp", "place"])
def test_the_job_after_one_that_failed_succeeds(ros_domain: int, tmp_path: Path, phase: str) -> None:
    words = io.StringIO()
    live = StopsEmulator(Console(file=words, width=200), phase)
    with cell(tmp_path, find_arm(), None, Build(1.0), live) as ready:
        live.emulator = ready.process_ids["emulator"]
        first, second = ready.runner.run("A"), ready.runner.run("B")
    assert not first.success
    assert "servo" in first.message, first
    assert second.success and second.bin == "B", words.getvalue()
