"""A bench's own processes: ready in time or the bench says so and ends, and gone with the bench, however that ends."""

import select
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from servoloop.stack.processes import end_with_parent

START_S: Final = 60.0


@contextmanager
def child(*command: str, says: str = "ready") -> Iterator["subprocess.Popen[str]"]:
    """Start ``python command`` and kill it behind the block. ``says``: its first line, once it can be used."""
    process = start(*command)
    try:
        line = next_line(process)
        if line != says:
            raise SystemExit(f"{' '.join(command[:3])}… is not ready: it says {line!r} and not {says!r}")
        yield process
    finally:
        kill(process)


def start(*command: str) -> "subprocess.Popen[str]":
    """Start ``python command``, which gets SIGTERM when the bench ends, however that ends."""
    return subprocess.Popen(
        [sys.executable, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=end_with_parent,
    )


def kill(process: "subprocess.Popen[str]") -> None:
    """End a process whatever it does."""
    process.kill()
    process.communicate()


def next_line(process: "subprocess.Popen[str]", patience_s: float = START_S) -> str:
    """The line that the process prints next; empty where it has ended. Ends the bench where nothing comes in time."""
    assert process.stdout is not None
    if not select.select([process.stdout], [], [], patience_s)[0]:
        raise SystemExit(f"process {process.pid} has said nothing for {patience_s:.0f} s: it hangs, the bench ends")
    hung = threading.Timer(patience_s, process.kill)
    hung.start()
    try:
        # The middleware tells on standard output of shared memory that others have left locked, and does without.
        return next((line.rstrip("\n") for line in process.stdout if "RTPS_TRANSPORT" not in line), "")
    finally:
        hung.cancel()
