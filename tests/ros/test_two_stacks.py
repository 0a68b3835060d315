"""Run the commands of docs/several-arms.md: two stacks of the same arm in one domain, each with its own job."""

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.pages import ROOT, commands
from tests.ros.stack_process import until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]

DOMAIN, LEFT, RIGHT, STOP, NODE, PICK, *_ = commands("several-arms.md")


class Program:
    """A command of the page that runs until the end of a test."""

    def __init__(self, command: str, log: Path) -> None:
        self.log = log
        with log.open("wb") as out:
            words = [part for part in shlex.split(command) if "=" not in part or part.startswith("__ns")]
            self.process = subprocess.Popen([sys.executable, *python(words)], stdout=out, stderr=out, cwd=ROOT)

    def wait_for(self, text: str) -> None:
        until(lambda: text in self.log.read_text(), lambda: self.process.poll() is not None and self.log.read_text())

    def end(self) -> int:
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(60.0)


def python(words: list[str]) -> list[str]:
    """Return the arguments with which Python of this environment runs a command."""
    return words[1:] if words[0] == "python" else ["-m", *words]


def once(command: str) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    words = [sys.executable, *python(shlex.split(command))]
    return subprocess.run(words, capture_output=True, text=True, cwd=ROOT, timeout=200)


@pytest.fixture
def stacks(ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ExitStack]:
    """Run both stacks of the page."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with ExitStack() as stack:
        for name, command in (("left", LEFT), ("right", RIGHT)):
            program = Program(command, tmp_path / f"{name}.log")
            stack.callback(program.end)
            program.wait_for("ready: so101")
        yield stack


@pytest.mark.runs(LEFT, RIGHT, STOP, NODE, PICK)
def test_the_commands_of_the_page_use_the_stack_of_their_namespace(stacks: ExitStack, tmp_path: Path) -> None:
    stopped = once(STOP)
    assert stopped.stdout == "all motions of so101 in /left were stopped\n", stopped.stderr
    node = Program(NODE, tmp_path / "node.log")
    stacks.callback(node.end)
    node.wait_for("ready for goals")
    picked = once(PICK)
    assert picked.returncode == 0 and "done: " in picked.stdout, picked.stdout + picked.stderr
    other = once(PICK.replace("left", "right"))
    assert "no node provides the action /right/sorting/arm/pick_place" in other.stderr


@pytest.mark.runs(DOMAIN)
def test_a_stack_starts_in_another_domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    setting, _, command = DOMAIN.partition(" ")
    name, _, value = setting.partition("=")
    monkeypatch.setenv(name, value)
    program = Program(command, tmp_path / "up.log")
    program.wait_for("ready: so101")
    assert f"with ROS_DOMAIN_ID {value} can command the arm" in program.log.read_text()
    assert program.end() == 0


def test_two_demos_in_one_domain_sort_all_their_cubes(ros_domain: int, tmp_path: Path) -> None:
    for name in ("left", "right"):
        (tmp_path / name).mkdir()
    demos = {
        name: Program(
            f"servoloop demo --arm so101 --namespace {name} --out {tmp_path / name}", tmp_path / name / "demo.log"
        )
        for name in ("left", "right")
    }
    ended = {name: demo.process.wait(350.0) for name, demo in demos.items()}
    assert ended == {"left": 0, "right": 0}, [demo.log.read_text() for demo in demos.values()]
    results = [json.loads((tmp_path / name / "result.json").read_text()) for name in demos]
    assert [result["cubes"] for result in results] == [{"in_their_bins": 3, "of": 3}] * 2
    assert os.environ["ROS_DOMAIN_ID"] == str(ros_domain)
