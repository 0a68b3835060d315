"""After a failed job, the demo starts again with the arm in its ready pose, the hand open and a cube on the stand."""

import io
import os
import signal
import threading
from pathlib import Path

import pytest
from rich.console import Console

from servoloop.demo.cell import cell
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.jobs import Live

pytestmark = pytest.mark.slow

SILENCE_S = 3.0


class StopsEmulator(Live):
    """Stop the emulator for some seconds in a given phase of the running job."""

    emulator = 0
    when = ""

    def phase(self, phase: str, message: str) -> None:
        super().phase(phase, message)
        if phase == self.when:
            self.when = ""
            os.kill(self.emulator, signal.SIGSTOP)
            threading.Timer(SILENCE_S, os.kill, (self.emulator, signal.SIGCONT)).start()


def test_job_after_a_failed_job_succeeds(ros_domain: int, tmp_path: Path) -> None:
    words = io.StringIO()
    live = StopsEmulator(Console(file=words, width=200))
    with cell(CellOptions(tmp_path), live) as ready:
        live.emulator = ready.process_ids["emulator"]
        for phase, grade in (("grasp", "A"), ("place", "B")):
            live.when = phase
            failed, after = ready.runner.run("C"), ready.runner.run(grade)
            assert not failed.success and not live.when
            assert "servo" in failed.message, failed
            assert after.success and after.bin == grade, words.getvalue()
