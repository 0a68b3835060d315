"""Output errors are reported, and NO_COLOR removes the colors of all output."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

COMMANDS = [("arms",), ("fault", "--list"), ("arms", "--json"), ("--help",), ("simulate", "--seconds", "0.1")]
MISTAKE = ("up", "--urdf", "nowhere.urdf")


def run(*words: str, stdout: int, stderr: int = subprocess.PIPE, **variables: str) -> "subprocess.Popen[bytes]":
    environment = {**os.environ, "TERM": "xterm-256color", **variables}
    command = [sys.executable, "-m", "servoloop", *words]
    return subprocess.Popen(command, stdout=stdout, stderr=stderr, env=environment)


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_full_disk_is_reported(words: tuple[str, ...]) -> None:
    with Path("/dev/full").open("wb") as full, run(*words, stdout=full.fileno()) as process:
        _, said = process.communicate(timeout=100.0)
    assert process.returncode == 1
    assert said.decode() == "servoloop: cannot write the output: No space left on device\n"


@pytest.mark.parametrize("words", COMMANDS[:3], ids=" ".join)
def test_a_closed_pipe_is_not_reported_as_an_error(words: tuple[str, ...]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with run(*words, stdout=writing) as process:
        os.close(writing)
        _, said = process.communicate(timeout=100.0)
    assert process.returncode == 1 and said == b""


def on_a_terminal(*words: str, **variables: str) -> bytes:
    """Return the output of a command in a terminal."""
    reading, ours = os.openpty()
    shown = bytearray()
    with run(*words, stdout=ours, stderr=ours, **variables) as process:
        os.close(ours)
        with contextlib.suppress(OSError):  # raised when the program has ended and closed the terminal
            while data := os.read(reading, 65536):
                shown += data
        process.wait(100.0)
    os.close(reading)
    return bytes(shown)


@pytest.mark.parametrize("words", [("arms",), MISTAKE, ("--help",)], ids=" ".join)
def test_no_color_is_honored(words: tuple[str, ...]) -> None:
    colors = (b"\x1b[3", b"\x1b[9", b"\x1b[4", b"\x1b[38", b"\x1b[48")
    shown = on_a_terminal(*words, NO_COLOR="1")
    assert not any(color in shown.replace(b"\x1b[3m", b"").replace(b"\x1b[4m", b"") for color in colors), shown
    if words == MISTAKE:
        assert b"\x1b[31m" in on_a_terminal(*words, NO_COLOR="")
