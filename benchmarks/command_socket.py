"""Measure the round-trip time of a stack's command socket: ``python -m benchmarks.command_socket [--messages 2000]``.

A stack without ROS runs at 20 Hz on mock hardware, in a separate process. One client sends each message after it has
received the reply to the previous message. The median must be at most 1 ms on an idle machine.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.shared.arguments import in_words, positive
from servoloop.command_socket.client import CommandClient
from servoloop.recording.stream import LiveError

PATIENCE_S: Final = 60.0
PAUSE_S: Final = 0.002
"""Time between two messages, in seconds. This pause keeps the message rate below the limit."""
HAND: Final = "hand_controller"


@contextmanager
def started_stack(*arguments: str) -> Iterator[None]:
    """Run ``servoloop up --no-ros`` in a separate process that clients in this process can find."""
    with tempfile.TemporaryDirectory(prefix="bench") as folder:
        ready, runtime = Path(folder) / "ready", {**os.environ, "XDG_RUNTIME_DIR": folder}
        os.environ["XDG_RUNTIME_DIR"] = folder
        command = [sys.executable, "-m", "servoloop", "up", "--no-ros", *arguments]
        with subprocess.Popen([*command, "--ready-file", str(ready)], env=runtime, stderr=subprocess.DEVNULL) as stack:
            try:
                deadline_s = time.monotonic() + PATIENCE_S
                while not ready.exists():
                    if stack.poll() is not None or time.monotonic() > deadline_s:
                        raise LiveError(f"the stack did not start: run `servoloop up --no-ros {' '.join(arguments)}`")
                    time.sleep(0.05)
                yield
            finally:
                stack.terminate()


@contextmanager
def running_stack() -> Iterator[CommandClient]:
    """Run a stack on mock hardware, and yield a client that has control of the arm."""
    with started_stack("--hardware", "mock"), CommandClient.find(name="benchmark") as client:
        client.request("take")
        yield client


def round_trips_ms(client: CommandClient, count: int, op: str, **fields: Any) -> np.ndarray:
    """Return the time from sending each message to receiving its reply, (count,) in milliseconds."""
    times = np.empty(count)
    for index in range(count):
        began_s = time.perf_counter()
        client.request(op, **fields)
        times[index] = (time.perf_counter() - began_s) * 1e3
        time.sleep(PAUSE_S)
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--messages", type=positive, default=2000, help="messages of each kind")
    count = parser.parse_args().messages
    table = Table("message", "median, ms", "99 %, ms", "longest, ms", title="round trip of the command socket")
    with in_words(), running_stack() as client:
        for op, fields in (
            ("take", {}),
            ("set_point", {"controller": HAND, "values": [0.02]}),
            ("state", {}),
            ("controllers", {}),
        ):
            times = round_trips_ms(client, count, op, **fields)
            figures = (np.median(times), np.percentile(times, 99.0), times.max())
            table.add_row(op, *(f"{figure:.2f}" for figure in figures))
    Console().print(table)


if __name__ == "__main__":
    main()
