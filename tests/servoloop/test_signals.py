"""The first signal (SIGINT, SIGTERM or SIGHUP) is counted, and the second one ends the program, even if the program is
blocked."""

import signal
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.servoloop.at_terminal import LIMIT_S, AtTerminal

HANGING = """
import ctypes
mutex = ctypes.create_string_buffer(64)  # zeros are PTHREAD_MUTEX_INITIALIZER
for _ in range(2): ctypes.CDLL(None).pthread_mutex_lock(mutex)  # no signal gets the main thread out of the second one
"""
WAITING = "while not signals.count: time.sleep(0.01)\n"


@contextmanager
def program(within: str, behind: str = "") -> Iterator["subprocess.Popen[bytes]"]:
    """Return a program that prints "ready", runs ``within`` in the context of Signals, and then runs ``behind``."""
    lines = [
        "import os, signal, sys, time",
        "from servoloop.stack.signals import Signals",
        "signals = Signals('it holds')",
    ]
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_is_only_counted(number: signal.Signals) -> None:
    with program(WAITING) as process:
        assert send(process, number) == (0, "calm\n", "")


@pytest.mark.parametrize("numbers", [(signal.SIGINT, signal.SIGTERM), (signal.SIGTERM, signal.SIGINT)])
def test_the_second_signal_ends_a_program_that_is_blocked_outside_python(numbers: tuple[signal.Signals, ...]) -> None:
    with program(f"{WAITING}print('one', flush=True){HANGING}") as process:
        process.send_signal(numbers[0])
        assert process.stdout is not None and process.stdout.readline() == b"one\n"
        status, _, words = send(process, numbers[1])
        assert (status, words) == (128 + numbers[1], "servoloop: ended at once by a second signal: it holds\n")


def test_the_second_signal_leaves_time_for_a_clean_end() -> None:
    with program("while signals.count < 2: time.sleep(0.01)\n") as process:
        process.send_signal(signal.SIGTERM)
        assert send(process, signal.SIGINT) == (0, "calm\n", "")


def test_a_program_that_hangs_after_the_context_is_also_ended() -> None:
    with program("while signals.count < 2: time.sleep(0.01)\n", HANGING) as process:
        process.send_signal(signal.SIGTERM)
        # If both signals are pending, the one with the lower number is delivered first.
        assert send(process, signal.SIGINT)[0] in (128 + signal.SIGINT, 128 + signal.SIGTERM)


def test_other_signals_are_not_counted_and_the_handlers_are_restored() -> None:
    count = "signal.signal(signal.SIGUSR1, lambda *_: None); os.kill(os.getpid(), signal.SIGUSR1); time.sleep(0.1)\n"
    check = "assert signals.count == 0; assert signal.getsignal(signal.SIGINT) is signal.default_int_handler"
    with program(count, check) as process:
        assert send(process) == (0, "calm\n", "")


def test_the_program_can_request_its_own_end() -> None:
    with program(f"signals.ask()\n{WAITING}signals.ask()\nassert signals.count == 1") as process:
        assert send(process) == (0, "calm\n", "")


def test_several_sighups_of_a_closed_terminal_count_as_one_signal() -> None:
    with program(f"{WAITING}time.sleep(0.3)\nassert signals.count == 1") as process:
        assert send(process, *[signal.SIGHUP] * 3) == (0, "calm\n", "")


def test_ctrl_c_after_a_closed_terminal_is_the_second_signal() -> None:
    with program(f"{WAITING}print('one', flush=True){HANGING}") as process:
        process.send_signal(signal.SIGHUP)
        assert process.stdout is not None and process.stdout.readline() == b"one\n"
        assert send(process, signal.SIGINT)[0] == 128 + signal.SIGINT


def test_under_nohup_a_closed_terminal_is_ignored() -> None:
    source = """
import os, signal, time
from servoloop.stack.signals import Signals
signal.signal(signal.SIGHUP, signal.SIG_IGN)
with Signals() as signals:
    os.kill(os.getpid(), signal.SIGHUP)
    time.sleep(0.2)
    assert signals.count == 0
"""
    assert subprocess.run([sys.executable, "-c", source], timeout=30.0).returncode == 0


HEAD = """
import sys, time
from pathlib import Path
from servoloop.stack.signals import Signals
from servoloop.stack.terminal import outlive_terminal
outlive_terminal()
"""
COUNTING = """
with Signals() as signals:
    print("ready")
    while not signals.count: time.sleep(0.01)
    for _ in range(3): print("on the way out")
    print("on the way out", file=sys.stderr, flush=True)
    Path(sys.argv[1]).write_text("ended")
"""
RAISING = """
from servoloop.commands.shared.line_options import Interrupted, interruptible
try:
    with interruptible():
        try:
            print("ready")
            time.sleep(30.0)
        finally:
            print("on the way out", file=sys.stderr)
            import os, signal
            os.kill(os.getpid(), signal.SIGHUP)  # the shell's
            time.sleep(0.1)
            Path(sys.argv[1]).write_text("ended")
except Interrupted as error:
    print(error)
"""


@pytest.mark.parametrize("source", [COUNTING, RAISING])
def test_a_program_whose_terminal_is_closed_ends_cleanly_although_it_prints(source: str, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    with AtTerminal([sys.executable, "-c", HEAD + source, str(mark)]) as terminal:
        terminal.wait_for("ready")
        terminal.close()
        assert terminal.process.wait(LIMIT_S) == 0
    assert mark.read_text() == "ended"


def test_a_program_that_is_ended_at_once_restores_its_terminal() -> None:
    raw = """
from servoloop.stack.terminal import raw_keys
with Signals() as signals, raw_keys():
    print("ready", flush=True)
    while True: time.sleep(0.01)
"""
    with AtTerminal([sys.executable, "-c", HEAD + raw]) as terminal:
        terminal.wait_for("ready")
        assert termios.tcgetattr(terminal.slave) != terminal.settings
        terminal.type("\x03")
        terminal.process.send_signal(signal.SIGTERM)
        assert terminal.process.wait(LIMIT_S) in (128 + signal.SIGINT, 128 + signal.SIGTERM)
        assert termios.tcgetattr(terminal.slave) == terminal.settings
