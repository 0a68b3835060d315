"""Runs commands with their output in log files, and says what to do when one fails."""

import os
import re
import subprocess
import threading
from collections.abc import Callable, Iterable
from pathlib import Path

from places import LOGS, ROOT, VENV

# What the shell may bring along that would mix another installation into ours.
FOREIGN = re.compile(r"(AMENT|COLCON|CMAKE|ROS|_ROS|PYTHON|CONDA)_?|LD_LIBRARY_PATH$|PIP_(USER|TARGET|PREFIX)$")


class SetUpError(Exception):
    """Carries what the user should read: what failed, and what to do."""


def environment() -> dict[str, str]:
    env = {name: value for name, value in os.environ.items() if not FOREIGN.match(name)}
    env["PATH"] = f"{VENV / 'bin'}{os.pathsep}{os.environ['PATH']}"
    env.setdefault("CC", "gcc")
    env.setdefault("CXX", "g++")
    return env | {"PYTHONUNBUFFERED": "1", "AMENT_PREFIX_PATH": str(VENV), "CMAKE_PREFIX_PATH": str(VENV)}


class Commands:
    """Runs commands with their output in log files, and ends them when set-up ends early."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def run(self, log_name: str, *command: str | Path, on_line: Callable[[str], None] = lambda line: None) -> None:
        log_path = LOGS / f"{log_name}.log"
        with log_path.open("a") as log:
            log.write(f"$ {' '.join(map(str, command))}\n")
            log.flush()
            process = self._start(command)
            assert process.stdout is not None
            for line in process.stdout:
                log.write(line)
                on_line(line)
            status = process.wait()
        self._running.discard(process)
        if status != 0:
            raise SetUpError(explain(log_path, command, status))

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            for process in list(self._running):
                process.terminate()

    def _start(self, command: Iterable[str | Path]) -> "subprocess.Popen[str]":
        with self._lock:
            if self._stopped:
                raise SetUpError("stopped")
            process = subprocess.Popen(
                list(map(str, command)),
                cwd=ROOT,
                env=environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
            )
            self._running.add(process)
            return process


HINTS = (
    (r"No space left on device", "The disk is full: .venv and build/ need 1 GB."),
    (r"DO NOT MATCH THE HASHES", "A package differs from the locked one. Do not install it; find out why."),
    (
        r"Temporary failure in name resolution|Connection|Max retries|timed out|CERTIFICATE|ProxyError"
        r"|No matching distribution found",
        "The package registry can not be reached or lacks this: look at the network, the proxy and pip config list.",
    ),
    (r"Python\.h", "This Python has no headers; on Debian or Ubuntu: sudo apt install python3-dev"),
    (r"Killed|cc1plus.*(memory|Terminated)", "The compiler ran out of memory: close something and try again."),
)


def explain(log_path: Path, command: Iterable[str | Path], status: int) -> str:
    text = log_path.read_text(errors="replace")
    tail = "\n".join("    " + line for line in text.splitlines()[-20:])
    hints = [hint for pattern, hint in HINTS if re.search(pattern, text)] or [
        "The reason should be in the lines above."
    ]
    program = " ".join(Path(part).name for part in list(map(str, command))[:3])
    return (
        f"{program} … failed with status {status}; the end of {log_path.relative_to(ROOT)}:\n{tail}\n\n{hints[0]}\n"
        "Then run make setup again: it goes on from here."
    )
