"""Child processes of a benchmark, which exit together with the benchmark. The benchmark is aborted if a process is not
ready in time."""

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
    """Start ``python command``, and kill the process at the end of the context.

    ``says`` is the first line that the process prints when it is ready.
    """
    process = start(*command)
    try:
        line = next_line(process)
        if line != says:
            raise SystemExit(f"{' '.join(command[:3])}… is not ready: it printed {line!r} instead of {says!r}")
        yield process
    finally:
        kill(process)


def start(*command: str) -> "subprocess.Popen[str]":
    """Start ``python command``. The process receives SIGTERM when the benchmark ends for any reason."""
    return subprocess.Popen(
        [sys.executable, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=end_with_parent,
    )


def kill(process: "subprocess.Popen[str]") -> None:
    """Kill a process and wait until it has exited."""
    process.kill()
    process.communicate()


def next_line(process: "subprocess.Popen[str]", patience_s: float = START_S) -> str:
    """Return the next line that the process prints, or an empty string if the process has exited.

    The benchmark ends if no line arrives in time.
    """
    assert process.stdout is not None
    if not select.select([process.stdout], [], [], patience_s)[0]:
        raise SystemExit(f"process {process.pid} has not printed anything for {patience_s:.0f} s")
    hung = threading.Timer(patience_s, process.kill)
    hung.start()
    try:
        # Skip a message that the middleware prints if other programs have left its shared memory locked.
        return next((line.rstrip("\n") for line in process.stdout if "RTPS_TRANSPORT" not in line), "")
    finally:
        hung.cancel()
