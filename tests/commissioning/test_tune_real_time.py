"""``servoloop tune`` in real time on a pseudo-terminal, interrupted during the motion."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim_backend.control import ask, control_path
from tests.commissioning.test_tune_verb import VIRTUAL


@pytest.mark.slow
@pytest.mark.runs(*VIRTUAL[:2])
@pytest.mark.timeout(180)
def test_stopping_a_tuning_in_motion_leaves_the_arm_held(tmp_path: Path) -> None:
    """Start a virtual arm with ``on_exit: hold``."""
    emulate, tune = (line.split() for line in VIRTUAL[:2])
    python = [sys.executable, "-m"]
    with subprocess.Popen([*python, *emulate], stdout=subprocess.PIPE, text=True, cwd=tmp_path) as emulator:
        try:
            assert emulator.stdout is not None and "ready" in emulator.stdout.readline()
            bus = control_path(tmp_path / "bus")
            _lies(bus)
            pipe = subprocess.PIPE
            with subprocess.Popen([*python, *tune], stdout=pipe, stderr=pipe, text=True, cwd=tmp_path) as tuning:
                moved_from = _position(bus)
                while abs(_position(bus) - moved_from) < 0.1:
                    assert tuning.poll() is None, tuning.communicate()
                tuning.send_signal(signal.SIGTERM)
                _, said = tuning.communicate(timeout=60.0)
            assert tuning.returncode == 130 and "stopped: the arm holds" in said
        finally:
            emulator.terminate()


def _position(bus: Path) -> float:
    return float(ask(bus, {"do": "look", "joints": []})["shoulder_lift"]["position"])


def _lies(bus: Path) -> None:
    """Wait until the released arm is at rest."""
    before, since_s = _position(bus), time.monotonic()
    while time.monotonic() - since_s < 0.5:
        if abs((now := _position(bus)) - before) > 1e-3:
            before, since_s = now, time.monotonic()
