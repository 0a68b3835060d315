"""``servoloop setup`` on the command line, with factory-new virtual servos of an SO-101."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import IO

import pytest

from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.driver_errors import PortLost
from drivers.port.serial_port import SerialPort
from servoloop.commands.set_up import _run
from servoloop.stack.arm_folders import find_arm, read_arm_files
from sim_backend.control import ask, control_path
from tests.commissioning.box import Bench, Hands

ROOT = Path(__file__).parents[2]
JOINTS = [joint.name for joint in read_arm_files(find_arm("so101")).robot.joints]
LIMIT_S = 60.0


@contextmanager
def program(*words: str) -> Iterator["subprocess.Popen[str]"]:
    command = [sys.executable, "-m", "servoloop", *words]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, cwd=ROOT)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Path]:
    link = tmp_path / "bus"
    with program("emulate", str(link), "--arm", "so101", "--box") as emulator:
        deadline_s = time.monotonic() + LIMIT_S
        while not (link.exists() and control_path(link).exists()):
            assert emulator.poll() is None, emulator.communicate()
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        yield link
        emulator.send_signal(signal.SIGINT)
        assert emulator.wait(LIMIT_S) == 0


def asked(err: IO[str]) -> str:
    """Return the next request to the user, skipping the output before it."""
    for line in err:
        if "press Enter" in line:
            return line
    raise AssertionError("it ended")


def plug(link: Path, setup: "subprocess.Popen[str]", *joints: str) -> None:
    """Connect these servos, or all of them, and press Enter."""
    ask(control_path(link), {"do": "connect", "joints": list(joints)})
    assert setup.stdin is not None
    setup.stdin.write("\n")
    setup.stdin.flush()


@pytest.mark.slow
@pytest.mark.runs("servoloop setup --arm so101 --turn --port /dev/ttyACM0")
def test_new_servos_are_set_up_in_several_interrupted_runs(link: Path) -> None:
    words = ("setup", "--arm", "so101", "--port", str(link), "--json")
    with program(*words, "--turn") as setup:
        assert setup.stderr is not None
        assert "only the servo for gripper. It gets ID 6. Its horn will turn" in asked(setup.stderr)
        plug(link, setup, "gripper")
        assert "gripper: the horn of servo 1 turns" in setup.stderr.readline()
        setup.send_signal(signal.SIGTERM)
        assert setup.wait(LIMIT_S) == 130
        assert "interrupted; no servo is set up yet" in setup.stderr.read()
    with closing(Bus(SerialPort(str(link), 1_000_000, MonotonicClock()), MonotonicClock())) as bus:
        assert not bus.torque_is_on(1)
    with program(*words) as setup:
        assert setup.stderr is not None
        for joint in reversed(JOINTS[4:]):
            assert f"only the servo for {joint}." in asked(setup.stderr)
            plug(link, setup, joint)
        assert f"only the servo for {JOINTS[3]}." in asked(setup.stderr)
        setup.send_signal(signal.SIGINT)
        assert setup.wait(LIMIT_S) == 130
        said = setup.stderr.read()
    assert "set up so far: gripper, wrist_roll" in said and "to continue" in said
    ask(control_path(link), {"do": "connect", "joints": JOINTS[4:]})
    with program(*words) as setup:
        assert setup.stderr is not None
        for joint in reversed(JOINTS[:4]):
            assert f"only the servo for {joint}." in asked(setup.stderr)
            plug(link, setup, joint)
        assert "all 6 servos in a chain" in asked(setup.stderr)
        plug(link, setup)
        out, said = setup.communicate(timeout=LIMIT_S)
        assert setup.returncode == 0
    assert f"the gears of {', '.join(JOINTS)} are unknown" in said
    audit = json.loads(out)
    assert [(row["joint"], row["servo_id"]) for row in audit] == [(name, i) for i, name in enumerate(JOINTS, 1)]
    assert [row["from_id"] for row in audit] == [1, 1, 1, 1, None, None]
    done = subprocess.run(
        [sys.executable, "-m", "servoloop", *words], input="", capture_output=True, text=True, cwd=ROOT, timeout=LIMIT_S
    )
    assert done.returncode == 0, done.stderr
    assert {tuple(row["changes"]) for row in json.loads(done.stdout)} == {()}


@pytest.mark.slow
def test_the_end_of_the_input_ends_the_setup_with_a_message(link: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "servoloop", "setup", "--arm", "so101", "--port", str(link)],
        **{"stdin": subprocess.DEVNULL, "capture_output": True, "text": True, "cwd": ROOT, "timeout": LIMIT_S},
        env=os.environ | {"COLUMNS": "200"},
    )
    assert done.returncode == 130
    assert "the input has ended; no servo is set up yet" in done.stderr


@pytest.mark.parametrize(("packets", "done"), [(3, "no servo is set up yet"), (250, "set up so far: gripper")])
def test_a_lost_port_is_reported_with_the_servos_done_and_how_to_continue(packets: int, done: str) -> None:
    bench, left = Bench(), [packets]

    def count(data: bytes) -> None:
        left[0] -= 1
        if left[0] == 0:
            bench.port.unplug()

    bench.port.before_write = count
    with pytest.raises(PortLost) as lost:
        _run(bench.set_up(Hands(bench)))
    assert done in lost.value.__notes__[-1] and "Run the same command again" in lost.value.__notes__[-1]
