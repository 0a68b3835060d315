"""Run the commands of docs/two-arms.md with virtual arms on pseudo-terminals, in real time."""

import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.live.rig import runtime_folder
from tests.pages import ROOT, code, commands
from tests.ros.stack_process import until

_DEMO, COMBINE, CHECK, MIXED, UP, *REST = commands("two-arms.md")
CALIBRATE_LEFT, CALIBRATE_RIGHT, VIRTUAL, NODE, PICK, _SIMULATE, LEADERS, TELEOP = REST

pytestmark = pytest.mark.timeout(280)
PORTS = ("/dev/ttyACM0", "/dev/ttyACM1", "/dev/ttyACM2", "/dev/ttyACM3")


@pytest.fixture(autouse=True)
def runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Isolate the test from other stacks."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    with runtime_folder(monkeypatch):
        yield


def words_of(command: str) -> list[str]:
    words = shlex.split(command.replace("config/", f"{ROOT}/config/"))
    return [sys.executable, *(words[1:] if words[0] == "python" else ["-m", *words])]


def run(command: str, folder: Path, status: int = 0) -> str:
    done = subprocess.run(
        words_of(command), capture_output=True, text=True, cwd=folder, stdin=subprocess.DEVNULL, timeout=120.0
    )
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout + done.stderr


@contextmanager
def started(command: str, folder: Path, ready: str) -> Iterator[Path]:
    """Run the command until the end of the block, and yield its log."""
    log = folder / f"{len(list(folder.glob('*.log')))}.log"
    with log.open("wb") as out:
        process = subprocess.Popen(words_of(command), stdout=out, stderr=out, stdin=subprocess.DEVNULL, cwd=folder)
    try:
        until(lambda: ready in log.read_text(), lambda: process.poll() is not None and log.read_text())
        yield log
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 0, log.read_text()


def at(command: str, *devices: str) -> str:
    """Return the command with virtual ports."""
    for port, device in zip(PORTS, devices, strict=False):
        command = command.replace(port, device)
    return command


@pytest.mark.slow
@pytest.mark.runs(COMBINE, CHECK, MIXED, UP, CALIBRATE_LEFT, CALIBRATE_RIGHT)
def test_a_new_robot_runs_and_each_of_its_arms_can_be_calibrated(ros_domain: int, tmp_path: Path) -> None:
    run(COMBINE, tmp_path)
    assert "two_arms: no problems found" in run(CHECK, tmp_path)
    assert "mixed_arms" in run(MIXED, tmp_path)
    with started("servoloop emulate ./bus --arm ./two_arms", tmp_path, "ready"):
        for command, name in ((CALIBRATE_LEFT, "left"), (CALIBRATE_RIGHT, "right")):
            said = run(at(command, f"./bus.{name}", f"./bus.{name}"), tmp_path, status=130)
            assert "Move every joint" in said and "nothing was stored" in said
        said = run("servoloop calibrate --arm ./two_arms --port ./bus.left", tmp_path, status=1)
        assert "has the buses left, right, which are calibrated one at a time: pass --port left=PATH" in said
        with started(at(UP, "./bus.left", "./bus.right"), tmp_path, "ready:"):
            pass


@pytest.mark.slow
@pytest.mark.runs(VIRTUAL, NODE, PICK)
def test_one_arm_sorts_a_cube_for_a_client_of_its_own(ros_domain: int, tmp_path: Path) -> None:
    with started(VIRTUAL, tmp_path, "ready:"), started(NODE, tmp_path, "ready for goals"):
        assert "done: " in run(PICK, tmp_path)


@pytest.mark.slow
@pytest.mark.runs(LEADERS, TELEOP)
def test_two_followers_follow_two_leaders(tmp_path: Path) -> None:
    run(COMBINE, tmp_path)
    run(LEADERS, tmp_path)
    leaders, followers = (
        f"servoloop emulate ./{bus} --arm ./{arm}" for bus, arm in (("l", "leaders"), ("f", "two_arms"))
    )
    with started(leaders, tmp_path, "ready"), started(followers, tmp_path, "ready"):
        command = at(TELEOP, "./l.left", "./f.left", "./l.right", "./f.right")
        assert "stdin is not a terminal" in run(command, tmp_path, status=1)
        with started(f"{command} --hands-free", tmp_path, "following"):
            pass


@pytest.mark.runs("two-arms.md python 1")
def test_the_program_moves_both_arms(capsys: pytest.CaptureFixture[str]) -> None:
    exec(code("two-arms.md", "python"), {"__name__": "example"})
    x, y, _ = map(float, capsys.readouterr().out.strip("()\n").split(", "))
    assert x > 0.0 and y < -0.2, "the right arm is on the right"
