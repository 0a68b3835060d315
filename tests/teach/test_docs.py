"""Run the commands of docs/teach.md on a virtual arm in real time, with typed keys."""

import json
import os
import pty
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from controller.teach.hand_path import BEFORE_S, GRID_S, TOLERANCE, WINDOW
from servoloop.manual.robot import LiveRobot
from servoloop.stack.shipped_files import ARMS
from servoloop.teach.play import APPROACH
from servoloop.teach.record import HANDS_S
from tests.pages import DOCS, blocks
from tests.recorder.rig import Rig
from tests.servoloop.served import eventually
from tests.teleop.test_docs import run, started

TEXT = (DOCS / "teach.md").read_text()
REAL, VIRTUAL, _, REPLAY = (block.commands for block in blocks("teach.md"))
EMULATE, RECORD, BEND, TURN, RELEASE, PLAY = VIRTUAL

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


def of_mine(command: str) -> str:
    """Return the command for a user's arm in a writable folder."""
    return command.replace("--arm so101", "--arm ./mine").replace("/dev/ttyACM0", "./bus")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'so101'}\n")
    return tmp_path


class Typing:
    """Program on a terminal with typed keys. ``output`` contains the output of the program."""

    def __init__(self, command: str, folder: Path) -> None:
        self._master, terminal = pty.openpty()
        words = [sys.executable, "-u", "-m", *shlex.split(command)]
        self.process = subprocess.Popen(
            words, stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=folder
        )
        os.close(terminal)
        self.output = ""
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        while text := self.process.stdout.read(1):
            self.output += text

    def type(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def hears(self, word: str) -> None:
        eventually(lambda: word in " ".join(self.output.split()) or self.process.poll() is not None, 60.0)
        assert word in " ".join(self.output.split()), self.output


@contextmanager
def typing(command: str, folder: Path) -> Iterator[Typing]:
    """Run the program while the context is active."""
    one = Typing(command, folder)
    try:
        yield one
    finally:
        one.process.kill()
        one.process.wait()


def place(joint: str, folder: Path) -> float:
    """Return the position of a joint."""
    return float(json.loads(run("servoloop hand ./bus look --json", folder).stdout)[joint]["position"])


@pytest.mark.runs(*REAL, *VIRTUAL)
def test_documented_commands_record_and_play_a_motion(folder: Path) -> None:
    with started(of_mine(EMULATE), folder, "ready"):
        with typing(of_mine(RECORD), folder) as record:
            record.hears("Keep a hand on the arm")
            record.type("y\n")
            record.hears("recording: move the arm")
            with LiveRobot.find("mine") as looking:
                looking.wait()
                assert looking.snapshot.joints[0] == "shoulder_pan"
            for command in (BEND, TURN):
                assert run(command, folder).returncode == 0
                *_, joint, there = shlex.split(command)
                eventually(lambda joint=joint, there=there: abs(place(joint, folder) - float(there)) < 0.03)
            record.type("\n")
            record.hears("the arm holds its position: release it")
            assert run(RELEASE, folder).returncode == 0
            assert record.process.wait(60.0) == 0 and "wave: a path of" in record.output
        with typing(of_mine(PLAY), folder) as play:
            play.hears("waiting: hold a key")
            assert abs(place("shoulder_pan", folder) - 0.5) < 0.05, "nothing moves yet"

            def held() -> bool:
                play.type("k")
                return play.process.poll() is not None

            eventually(held, 90.0)
            assert play.process.wait() == 0 and "playing" in play.output
        assert abs(place("shoulder_pan", folder) - 0.5) < 0.05 and abs(place("elbow_flex", folder) - 1.2) < 0.06
        listing, forgetting = map(of_mine, REAL[2:])
        assert run(listing, folder).stdout.startswith("wave: a path of")
        assert run(forgetting, folder).returncode == 0
        assert run(listing, folder).stdout.startswith("no motions are saved in ")


def test_commands_for_real_and_virtual_arms_are_equal() -> None:
    assert [of_mine(command) for command in REAL[:2]] == [of_mine(RECORD), of_mine(PLAY).removesuffix(" --speed 0.5")]


def test_ctrl_c_saves_the_motion_and_the_arm_holds_its_position(folder: Path) -> None:
    with started(of_mine(EMULATE), folder, "ready"), typing(f"{of_mine(RECORD)} --limp --yes", folder) as record:
        record.hears("recording: move the arm")
        assert run(BEND, folder).returncode == 0
        eventually(lambda: abs(place("elbow_flex", folder) - 1.2) < 0.03)
        record.process.send_signal(signal.SIGINT)
        record.hears("the arm holds its position: release it")
        assert record.process.wait(60.0) == 0 and "wave: a path of" in record.output
        assert run(RELEASE, folder).returncode == 0
        assert abs(place("elbow_flex", folder) - 1.2) < 0.1


@pytest.mark.runs(REPLAY[0])
def test_documented_replay_moves_the_virtual_arm(tmp_path: Path) -> None:
    rig = Rig((0.0, 0.0, -0.6, -0.8, -0.95, -1.68))
    rig.stack.go((0.4, 0.1, -0.4, -0.8, -0.95, -1.68))
    rig.run(2.4)
    rig.record(tmp_path / "run.mcap")
    onto, _, shown = REPLAY
    assert shlex.split(shown) == shlex.split(onto)[:3]
    with started("servoloop emulate ./bus", tmp_path, "ready"):
        replayed = run(f"{of_mine(onto)} --hands-free", tmp_path)
        assert replayed.returncode == 0 and "playing" in replayed.stderr, replayed.stderr
        assert abs(place("joint1", tmp_path) - 0.4) < 0.03
        refused = run(of_mine(onto), tmp_path)
        assert refused.returncode == 1 and "stdin is not a terminal" in refused.stderr


def test_figures_in_the_docs_match_the_code() -> None:
    prose = " ".join(TEXT.split())
    assert APPROACH == 0.25 and "a quarter of each joint's velocity limit" in prose
    assert HANDS_S == 2.0 and "The arm holds its position for two seconds" in prose
    assert TOLERANCE == 0.001 and "by at most 0.1 % of each joint's range" in prose
    assert WINDOW * GRID_S == BEFORE_S == pytest.approx(0.3) and "averaged out, over 0.3 s" in prose
