"""The processes of a demo: started, watched, ended in the opposite order, their words kept."""

import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType

from drivers.clock import MonotonicClock
from drivers.errors import DriverError

END_S = 60.0


class Processes:
    """A context manager. What a process prints goes to ``folder``/NAME.log."""

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self._folder = folder
        self._environment = dict(environment)
        self._running: list[tuple[str, subprocess.Popen[bytes]]] = []

    def start(self, name: str, module: str, *arguments: str) -> int:
        """Start ``python -m module arguments``; returns the process ID."""
        with (self._folder / f"{name}.log").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=self._environment,
                start_new_session=True,  # Ctrl-C reaches the demo, which ends them in order
            )
        self._running.append((name, process))
        return process.pid

    def check(self) -> None:
        """Raise DriverError with the last words of a process that has ended by itself."""
        for name, process in self._running:
            if process.poll() is not None:
                lines = (self._folder / f"{name}.log").read_text(errors="replace").splitlines()
                words = "\n  ".join(lines[-12:])
                raise DriverError(f"{name} ended (status {process.returncode}):\n  {words}")

    def wait_until(self, ready: Callable[[], bool], what: str, timeout_s: float) -> None:
        """Wait for a condition while all processes live."""
        clock = MonotonicClock()
        deadline_s = clock.now() + timeout_s
        while not ready():
            self.check()
            if clock.now() > deadline_s:
                raise DriverError(f"{what} took longer than {timeout_s:.0f} s")
            clock.sleep_until(clock.now() + 0.02)

    def end(self) -> dict[str, int]:
        """End all, the last started first; returns their exit statuses."""
        statuses: dict[str, int] = {}
        while self._running:
            name, process = self._running.pop()
            process.terminate()
            try:
                statuses[name] = process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                statuses[name] = process.wait()
        return statuses

    def __enter__(self) -> "Processes":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end()
