"""Run ``servoloop plan-server`` as a child process of a stack, so that planning never delays the control loop."""

import logging
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from servoloop.stack.processes import end, end_with_parent
from servoloop.stack.robot_files import Files

END_S: Final = 15.0
"""Maximum time for the server to stop its motions and exit, in seconds."""
NICENESS: Final = 5
"""Increase of the server's nice value relative to the stack, which lowers the server's priority."""
LOG: Final = logging.getLogger("servoloop")


@contextmanager
def planning_server(files: Files, *, sim_time: bool) -> Iterator[None]:
    """Run the planning server of an arm alongside its stack.

    If the server exits early, the stack continues. At the end of the context, the server slows its motions down along
    their paths, and exits.

    Args:
        files: Files of the arm.
        sim_time: Whether the stack runs in simulated time.
    """
    arguments = ("plan-server", *files.options, *(("--sim-time",) if sim_time else ()))
    process = subprocess.Popen(
        [sys.executable, "-m", "servoloop", *arguments],
        stdin=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C must reach only this process, which then ends the server
        preexec_fn=_begin,
    )
    ending = threading.Event()
    threading.Thread(target=_watch, args=(process, ending), name="planning server", daemon=True).start()
    try:
        yield
    finally:
        ending.set()
        end(process, END_S)


def _begin() -> None:
    end_with_parent()
    os.nice(NICENESS)
    # The server gives up the real-time priority that it inherits from the stack.
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _watch(process: "subprocess.Popen[bytes]", ending: threading.Event) -> None:
    status = process.wait()
    if not ending.is_set():
        LOG.error("the planning server has exited (exit status %d): the stack continues without it", status)
