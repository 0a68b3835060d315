"""SIGINT and SIGTERM: the first is counted, the second ends a program, whatever it waits for."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

HANGING = """
import ctypes
mutex = ctypes.create_string_buffer(64)  # zeros are PTHREAD_MUTEX_INITIALIZER
for _ in range(2): ctypes.CDLL(None).pthread_mutex_lock(mutex)  # no signal gets the main thread out of the second one
"""
WAITING = "while not signals.count: time.sleep(0.01)\n"


@contextmanager
def program(within: str, behind: str = "") -> Iterator["subprocess.Popen[bytes]"]:
    """Python that prints "ready" and then does this within the context of Signals, and that behind it."""
    lines = ["import os, signal, sys, time", "from servoloop.signals import Signals", "signals = Signals('it holds')"]
    lines += ["with signals:", "    print('ready', flush=True)", *(f"    {line}" for line in within.splitlines())]
    source = "\n".join([*lines, "print('calm', flush=True)", *behind.splitlines()])
    process = subprocess.Popen(
        [sys.executable, "-c", source], stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0
    )
    try:
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def send(process: "subprocess.Popen[bytes]", *numbers: signal.Signals) -> tuple[int, str, str]:
    for number in numbers:
        process.send_signal(number)
    out, words = process.communicate(timeout=30.0)
    return process.returncode, out.decode(), words.decode()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_is_a_count_and_no_more(number: signal.Signals) -> None:
    with program(WAITING) as process:
        assert send(process, number) == (0, "calm\n", "")


@pytest.mark.parametrize("numbers", [(signal.SIGINT, signal.SIGTERM), (signal.SIGTERM, signal.SIGINT)])
def test_the_second_signal_ends_a_program_that_is_not_back_in_python(numbers: tuple[signal.Signals, ...]) -> None:
    with program(f"{WAITING}print('one', flush=True){HANGING}") as process:
        process.send_signal(numbers[0])
        assert process.stdout is not None and process.stdout.readline() == b"one\n"
        status, _, words = send(process, numbers[1])
        assert (status, words) == (128 + numbers[1], "servoloop: a second signal: ended at once: it holds\n")


def test_the_second_signal_leaves_the_time_for_an_end_of_its_own() -> None:
    with program("while signals.count < 2: time.sleep(0.01)\n") as process:
        process.send_signal(signal.SIGTERM)
        assert send(process, signal.SIGINT) == (0, "calm\n", "")


def test_a_program_that_hangs_behind_the_context_is_ended_too() -> None:
    with program("while signals.count < 2: time.sleep(0.01)\n", HANGING) as process:
        process.send_signal(signal.SIGTERM)
        # Where both wait to be delivered, the one with the lower number comes first.
        assert send(process, signal.SIGINT)[0] in (128 + signal.SIGINT, 128 + signal.SIGTERM)


def test_other_signals_are_not_counted_and_the_former_handlers_come_back() -> None:
    count = "signal.signal(signal.SIGUSR1, lambda *_: None); os.kill(os.getpid(), signal.SIGUSR1); time.sleep(0.1)\n"
    check = "assert signals.count == 0; assert signal.getsignal(signal.SIGINT) is signal.default_int_handler"
    with program(count, check) as process:
        assert send(process) == (0, "calm\n", "")


def test_the_program_itself_can_ask_for_the_end() -> None:
    with program(f"signals.ask()\n{WAITING}signals.ask()\nassert signals.count == 1") as process:
        assert send(process) == (0, "calm\n", "")
