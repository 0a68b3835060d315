"""Run every command of the README."""

import json
import os
import shlex
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.pages import commands
from tests.ros.stack_process import PATIENCE_S, emulating, until

ROOT = Path(__file__).parents[2]
NODE = "python -m nodes.vision_pick_place_controller --ros-args --params-file config/vision_pick_place_controller.yaml"
TWO_BUSES = "--robot config/robot_arm_two_buses.yaml"
SERVERS = {
    "servoloop up": "ready: robot_arm",
    "servoloop up --port /dev/ttyACM0": "ready: robot_arm",
    f"servoloop up {TWO_BUSES} --port arm=/dev/ttyACM0 --port hand=/dev/ttyUSB0": "ready: robot_arm",
    "servoloop up --hardware mujoco": "ready: robot_arm",
    "servoloop up --hardware mock": "ready: robot_arm",
    "servoloop up --port ./bus": "ready: robot_arm",
    "servoloop emulate ./bus": "ready: 7 servos",
}
"""Commands that run until they are ended, with the output that shows that they are ready."""
TOGETHER = (". .venv/bin/activate", NODE, "servoloop pick B")
MEASURE = "servoloop bench bus --port /dev/ttyACM0 --ids 1-7 --model sts3215"
ONCE = {
    MEASURE: f"{MEASURE} --cycles 50".replace("/dev/ttyACM0", "{link}"),
    f"servoloop demo {TWO_BUSES}": f"servoloop demo {TWO_BUSES} --grades B --out {{tmp}}",
    "make demo": "make demo DEMO_ARGS='--out {tmp}'",
    "make test": "make test PYTEST_ARGS='tests/servoloop/test_following.py'",
}
"""Commands that end without a signal, with arguments that shorten their run in these tests."""


@pytest.fixture
def environment(ros_domain: int) -> dict[str, str]:
    """Environment variables of a shell with the activated environment."""
    return {**os.environ, "PATH": f"{ROOT / '.venv' / 'bin'}:{os.environ['PATH']}", "ROS_DOMAIN_ID": str(ros_domain)}


class Served:
    """Process of a command that runs until the end of the test."""

    def __init__(self, command: str, log: Path, environment: dict[str, str]) -> None:
        self.log = log
        with log.open("wb") as out:
            self.process = subprocess.Popen(shlex.split(command), stdout=out, stderr=out, env=environment, cwd=ROOT)

    def wait_for(self, words: str) -> None:
        until(lambda: words in self.log.read_text(), lambda: self.process.poll() is not None and self.log.read_text())

    def end(self) -> int:
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(PATIENCE_S)


def test_tables_contain_every_command_of_the_readme() -> None:
    assert set(commands("README.md")) == {*SERVERS, *ONCE, *TOGETHER}


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Path]:
    with emulating(tmp_path) as link:
        yield link


@pytest.mark.slow
@pytest.mark.runs(*SERVERS)
@pytest.mark.parametrize("command", sorted(SERVERS))
def test_server_starts_and_ends_cleanly(command: str, tmp_path: Path, link: Path, environment: dict[str, str]) -> None:
    """An emulator replaces the port, because this machine has no arm."""
    here = str(tmp_path / "mine") if "emulate" in command else str(link)
    words = SERVERS[command]
    with ExitStack() as stack:
        if TWO_BUSES in command:
            emulator = Served(f"servoloop emulate {tmp_path}/two {TWO_BUSES}", tmp_path / "two.log", environment)
            stack.callback(emulator.end)
            emulator.wait_for("ready: 7 servos")
        command = command.replace("arm=/dev/ttyACM0", f"arm={tmp_path}/two.arm")
        command = command.replace("hand=/dev/ttyUSB0", f"hand={tmp_path}/two.hand")
        served = Served(command.replace("/dev/ttyACM0", here).replace("./bus", here), tmp_path / "log", environment)
        served.wait_for(words)
        assert served.end() == 0


@pytest.mark.slow
@pytest.mark.runs(*TOGETHER)
def test_stack_node_and_pick_work_together_as_documented(tmp_path: Path, environment: dict[str, str]) -> None:
    stack = Served("servoloop up", tmp_path / "up", environment)
    stack.wait_for("ready: ")
    node = Served(NODE, tmp_path / "node", environment)
    try:
        script = ". .venv/bin/activate && servoloop pick B"
        done = subprocess.run(["sh", "-c", script], env=environment, cwd=ROOT, capture_output=True, timeout=90)
        assert done.returncode == 0, done.stdout.decode() + done.stderr.decode()
    finally:
        assert node.end() == 0
        assert stack.end() == 0


@pytest.mark.slow
@pytest.mark.timeout(240)
@pytest.mark.runs(*ONCE)
@pytest.mark.parametrize("command", sorted(ONCE))
def test_commands_that_end_succeed(command: str, tmp_path: Path, link: Path, environment: dict[str, str]) -> None:
    full = ONCE[command].format(tmp=tmp_path / "out", link=link)
    done = subprocess.run(full, shell=True, env=environment, cwd=ROOT, capture_output=True, text=True, timeout=220)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    if "demo" in command:
        result = json.loads((tmp_path / "out" / "result.json").read_text())
        cubes, without = (3, ["gravity compensation", "lead"]) if command == "make demo" else (1, [])
        assert result["cubes"]["of"] == cubes and list(result["without"]) == without
