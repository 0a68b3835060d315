"""The pick-and-place node stops on a signal or when its terminal closes, and a second signal ends it immediately."""

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from nodes.stop_signals import ARM_CONTINUES

PROGRAM = """
import sys
import time
from nodes.stop_signals import on_stop_signal
on_stop_signal(lambda: print("stop", flush=True), *sys.argv[1:])
print("up", flush=True)
time.sleep(60)
"""
UNDER_NOHUP = "import signal\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)\n"


def start(program: str, *arguments: str) -> "subprocess.Popen[str]":
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert next_line(process) == "up"
    return process


def next_line(process: "subprocess.Popen[str]") -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


@pytest.fixture
def process() -> Iterator["subprocess.Popen[str]"]:
    process = start(PROGRAM)
    yield process
    process.kill()
    process.communicate()


def test_two_hangup_signals_of_a_closed_terminal_stop_the_node_once(process: "subprocess.Popen[str]") -> None:
    process.send_signal(signal.SIGHUP)
    assert next_line(process) == "stop"
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)
    assert process.wait(30.0) == 128 + signal.SIGTERM


def test_closed_terminal_is_ignored_under_nohup() -> None:
    process = start(UNDER_NOHUP + PROGRAM)
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGINT)
    assert next_line(process) == "stop"
    process.send_signal(signal.SIGINT)
    assert process.wait(30.0) == 128 + signal.SIGINT
    process.communicate()


@pytest.mark.parametrize("arguments", [(), (ARM_CONTINUES,)], ids=["no arm", "an arm"])
def test_second_signal_describes_the_arm_only_if_the_program_moves_one(arguments: tuple[str, ...]) -> None:
    process = start(PROGRAM, *arguments)
    process.send_signal(signal.SIGINT)
    assert next_line(process) == "stop"
    process.send_signal(signal.SIGINT)
    _, log = process.communicate(timeout=30.0)
    assert log == " ".join(["second signal: ended at once.", *arguments]) + "\n"
