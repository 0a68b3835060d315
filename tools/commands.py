"""Run commands with their output in log files, and report how to fix the problem if a command fails."""

import contextlib
import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

from places import LOGS, ROOT, VENV

# Shell variables that would mix another installation into this installation.
FOREIGN = re.compile(r"(AMENT|COLCON|CMAKE|ROS|_ROS|PYTHON|CONDA)_?|LD_LIBRARY_PATH$|PIP_(USER|TARGET|PREFIX)$")


COMMAND_S = 3600.0
"""Maximum duration of one command, in seconds. uv ends stalled connections itself, but the slowest build takes
minutes."""
STOP_S = 5.0
"""Time a command has to stop before it is killed, in seconds."""


class ToolError(Exception):
    """Raised if the setup cannot continue. The message contains the cause and the remedy."""


def environment() -> dict[str, str]:
    env = {name: value for name, value in os.environ.items() if not FOREIGN.match(name)}
    env["PATH"] = f"{VENV / 'bin'}{os.pathsep}{os.environ['PATH']}"
    env.setdefault("CC", "gcc")
    env.setdefault("CXX", "g++")
    return env | {"PYTHONUNBUFFERED": "1", "AMENT_PREFIX_PATH": str(VENV), "CMAKE_PREFIX_PATH": str(VENV)}


class Commands:
    """Runs commands with their output in log files. If the setup is aborted, all running commands are stopped."""

    def __init__(self, limit_s: float = COMMAND_S) -> None:
        self._limit_s = limit_s
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def run(
        self,
        log_name: str,
        *command: str | Path,
        on_line: Callable[[str], None] = lambda line: None,
        variables: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Run a command with ``variables`` in its environment."""
        log_path = LOGS / f"{log_name}.log"
        with log_path.open("a") as log:
            log.write(f"$ {' '.join(map(str, command))}\n")
            log.flush()
            process = self._start(command, variables)
            assert process.stdout is not None
            too_long = threading.Timer(self._limit_s, signal_all, (process, signal.SIGKILL))
            too_long.daemon = True
            too_long.start()
            for line in process.stdout:
                log.write(line)
                on_line(line)
            status = process.wait()
            if too_long.finished.is_set():
                log.write(f"Killed: it had not ended after {self._limit_s:.0f} s.\n")
            too_long.cancel()
        self._running.discard(process)
        if status != 0:
            raise ToolError(explain(log_path, command, status))

    def stop(self) -> None:
        """Stop all running commands with their child processes. Kill the commands that do not stop in time or after a
        Ctrl-C."""
        with self._lock:
            self._stopped = True
        running = list(self._running)
        try:
            for process in running:
                signal_all(process, signal.SIGTERM)
            deadline_s = time.monotonic() + STOP_S
            while any(process.poll() is None for process in running) and time.monotonic() < deadline_s:
                time.sleep(0.05)
        finally:
            for process in running:
                signal_all(process, signal.SIGKILL)

    def _start(self, command: Iterable[str | Path], variables: Mapping[str, str]) -> "subprocess.Popen[str]":
        with self._lock:
            if self._stopped:
                raise ToolError("stopped")
            process = subprocess.Popen(
                list(map(str, command)),
                cwd=ROOT,
                env=environment() | dict(variables),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                # Ending the session of the command also ends the compilers that it has started.
                start_new_session=True,
            )
            self._running.add(process)
            return process


def signal_all(process: "subprocess.Popen[str]", number: int) -> None:
    """Send a signal to a command and all its child processes."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, number)


HINTS = (
    (r"Killed: it had not ended", "The command hangs: check the end of the log and the load of this machine."),
    (r"No space left on device", "The disk is full: .venv and build/ need 2 GB."),
    (
        r"DO NOT MATCH THE HASHES|Hash mismatch",
        "A package differs from its locked version. Do not install it until you know the reason.",
    ),
    (
        r"Temporary failure in name resolution|Connection|Max retries|timed out|CERTIFICATE|ProxyError"
        r"|No matching distribution found|Failed to fetch|No solution found",
        "The package registry cannot be reached or does not have this package: check the network and the proxy. To "
        "use your own registry, set it with `pip config` for pip and with UV_DEFAULT_INDEX for uv.",
    ),
    (r"Python\.h", "This Python has no headers; on Debian or Ubuntu: sudo apt install python3-dev"),
    (r"Killed|cc1plus.*(memory|Terminated)", "The compiler ran out of memory: close other programs and try again."),
)


def explain(log_path: Path, command: Iterable[str | Path], status: int) -> str:
    text = log_path.read_text(errors="replace")
    tail = "\n".join("    " + line for line in text.splitlines()[-20:])
    hints = [hint for pattern, hint in HINTS if re.search(pattern, text)] or [
        "The lines above should contain the reason."
    ]
    program = " ".join(Path(part).name for part in list(map(str, command))[:3])
    return (
        f"{program} … failed with status {status}; the end of {log_path.relative_to(ROOT)}:\n{tail}\n\n{hints[0]}\n"
        "Then run make setup again: it continues from here."
    )
