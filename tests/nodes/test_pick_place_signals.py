"""The pick-place node stops at a signal, also at that of a terminal that was closed; a second one ends it."""

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

PROGRAM = """
import time
from nodes.pick_place.signals import on_stop_signal
on_stop_signal(lambda: print("stop", flush=True))
print("up", flush=True)
time.sleep(60)
"""
UNDER_NOHUP = "import signal\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)\n"


def start(program: str) -> "subprocess.Popen[str]":
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert said(process) == "up"
    return process


def said(process: "subprocess.Popen[str]") -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


@pytest.fixture
def process() -> Iterator["subprocess.Popen[str]"]:
    process = start(PROGRAM)
    yield process
    process.kill()
    process.communicate()


def test_a_closed_terminal_is_told_twice_and_stops_it_once(process: "subprocess.Popen[str]") -> None:
    process.send_signal(signal.SIGHUP)
    assert said(process) == "stop"
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)
    assert process.wait(30.0) == 128 + signal.SIGTERM


def test_under_nohup_a_closed_terminal_stops_nothing() -> None:
    process = start(UNDER_NOHUP + PROGRAM)
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGINT)
    assert said(process) == "stop"
    process.send_signal(signal.SIGINT)
    assert process.wait(30.0) == 128 + signal.SIGINT
    process.communicate()
