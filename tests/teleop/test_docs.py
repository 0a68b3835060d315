"""Run the commands of docs/teleop.md with two virtual arms on pseudo-terminals, in real time."""

import json
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tests.live.rig import runtime_folder
from tests.pages import commands
from tests.recorder.reading import by_rosbags
from tests.servoloop.served import eventually

REAL, LEADER, FOLLOWER, TELEOP, HAND = commands("teleop.md")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


@contextmanager
def started(command: str, folder: Path, word: str) -> Iterator["subprocess.Popen[str]"]:
    """Run the command as a process within the context, and wait until it prints a word."""
    words = [sys.executable, "-m", *shlex.split(command)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True, cwd=folder) as process:
        try:
            assert process.stdout is not None
            assert any(word in line for line in process.stdout)
            yield process
        finally:
            process.terminate()


def run(command: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    words = [sys.executable, "-m", *shlex.split(command)]
    return subprocess.run(words, capture_output=True, text=True, cwd=folder, stdin=subprocess.DEVNULL, timeout=60.0)


def pan(arm: str, folder: Path) -> float:
    """Return the position of an arm's first joint."""
    return float(json.loads(run(f"servoloop hand ./{arm} look --json", folder).stdout)["shoulder_pan"]["position"])


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with runtime_folder(monkeypatch):
        yield


def look_on(folder: Path) -> None:
    """Record the running teleoperation, with both arms and the traffic on both buses."""
    recorded = run("servoloop record both.mcap --arm so101 --seconds 1", folder)
    assert recorded.returncode == 0, recorded.stderr
    found = by_rosbags(folder / "both.mcap")
    state = found["/joint_states"][-1]
    assert {"shoulder_pan", "leader/shoulder_pan"} <= set(state.name) and np.isfinite(state.position).all()
    assert {traffic.header.frame_id for traffic in found["/servoloop/bus_traffic"]} == {"./leader", "./follower"}


@pytest.mark.runs(REAL, LEADER, FOLLOWER, TELEOP, HAND)
def test_documented_commands_make_the_follower_follow(tmp_path: Path) -> None:
    with started(LEADER, tmp_path, "ready"), started(FOLLOWER, tmp_path, "ready"):
        assert run("servoloop hand ./leader hold", tmp_path).returncode == 0
        with started(TELEOP, tmp_path, "following") as teleop:
            assert run(HAND, tmp_path).returncode == 0
            eventually(lambda: pan("follower", tmp_path) > 0.3)
            eventually(lambda: abs(pan("follower", tmp_path) - pan("leader", tmp_path)) < 0.03)
            look_on(tmp_path)
            teleop.send_signal(signal.SIGINT)
            assert teleop.stdout is not None
            output = teleop.stdout.read()
            assert "from the leader's angles to the follower's goals: median" in " ".join(output.split())
            assert teleop.wait(30.0) == 0
        refused = run(REAL.replace("/dev/ttyACM0", "./leader").replace("/dev/ttyACM1", "./follower"), tmp_path)
        assert refused.returncode == 1 and "stdin is not a terminal" in refused.stderr


def test_two_arms_need_two_ports(tmp_path: Path) -> None:
    refused = run("servoloop teleop ./bus ./bus --hands-free", tmp_path)
    assert refused.returncode == 1 and "cannot share a port" in refused.stderr
