"""Run a virtual bus on a pseudo-terminal, or the ROS stack, in a separate process for tests."""

import fcntl
import os
import random
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from drivers.clock import MonotonicClock
from drivers.driver_errors import DriverError
from nodes.discovery import stay_on_this_machine

DOMAINS = range(1, 98, 4)
"""ROS domain IDs for tests. A run may also use the two IDs that follow.

Other programs may use the network ports that belong to domain IDs of 102 and above.
"""


@contextmanager
def free_domain() -> Iterator[int]:
    """Yield a ROS domain ID that no other test run on this computer uses.

    A lock on a file reserves the ID. The lock is released when the process exits, even if the process is killed.
    """
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        with Path(tempfile.gettempdir(), f"servoloop-tests-of-{os.getuid()}-ros-domain-{domain}").open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise RuntimeError("every ROS domain is in use by another test run on this machine")


@contextmanager
def own_domain(settings: Mapping[str, str]) -> Iterator[int]:
    """Set environment variables until the context exits: a free ROS domain that is limited to this computer, and
    ``settings``."""
    with free_domain() as domain:
        environment = {"ROS_DOMAIN_ID": str(domain), **settings}
        stay_on_this_machine(environment)
        before = {name: os.environ.get(name) for name in environment}
        os.environ.update(environment)
        try:
            yield domain
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


START_S = 60.0
END_S = 30.0
POLL_S = 0.02


class ProcessTestError(DriverError):
    """Raised when a servoloop process did not start. The message contains the output of the process."""


class _Process:
    """A ``servoloop`` process that runs while its context is active."""

    def __init__(self, files: Mapping[str, Any], folder: Path) -> None:
        self.log = folder / "servoloop.log"
        """File that contains the output of the process."""
        self._files = [text for name, value in files.items() for text in (f"--{name}", str(value))]
        self._folder = folder

    @contextmanager
    def _run(self, verb: Sequence[str], ready: Callable[[], bool]) -> Iterator[None]:
        with self.log.open("wb") as output:
            command = [sys.executable, "-m", "servoloop", *verb, *self._files]
            process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
        try:
            self._wait_for(ready, process)
            yield
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _wait_for(self, ready: Callable[[], bool], process: "subprocess.Popen[bytes]") -> None:
        clock = MonotonicClock()
        deadline_s = clock.now() + START_S
        while not ready():
            if process.poll() is not None or clock.now() > deadline_s:
                raise ProcessTestError(f"servoloop did not start:\n{self.log.read_text(errors='replace')}")
            clock.sleep_until(clock.now() + POLL_S)


class VirtualBusProcess(_Process):
    """Process of ``servoloop emulate``. Any client of a serial port can use ``port``."""

    def __init__(
        self, files: Mapping[str, Any], folder: Path, seed: int | None = None, backlash_deg: float = 1.0
    ) -> None:
        super().__init__({name: path for name, path in files.items() if name != "controllers"}, folder)
        self.port = str(folder / "bus")
        """Path of the serial port. With several buses, each bus has this path followed by ``.NAME``."""
        self._seed = () if seed is None else ("--seed", str(seed))
        self._backlash = ("--backlash", str(backlash_deg))

    @contextmanager
    def running(self) -> Iterator[Self]:
        """Run the virtual servos within the context."""
        with self._run(("emulate", self.port, *self._seed, *self._backlash), self._ready):
            yield self

    def _ready(self) -> bool:
        """Return whether the emulator has printed that clients can open its buses."""
        return any(line.startswith(b"ready: ") for line in self.log.read_bytes().splitlines())

    def fault(self, text: str) -> None:
        """Inject a fault such as ``silent id=3 for=2s``. Raises ValueError if the fault is not supported."""
        from sim_backend.control import ask, control_path

        ask(control_path(Path(self.port)), {"do": "fault", "text": text})


class RosStack(_Process):
    """Process of ``servoloop up`` with virtual servos, in a ROS domain shared only with the test."""

    def __init__(self, files: Mapping[str, Any], folder: Path, rtf: float | str | None = None) -> None:
        super().__init__(files, folder)
        self.domain = -1
        """ROS_DOMAIN_ID of the stack. The ID is also set in ``os.environ`` while the stack runs."""
        self._rtf = () if rtf is None else ("--rtf", str(rtf))

    @contextmanager
    def running(self) -> Iterator[Self]:
        """Run the stack within the context. Nodes and processes created by the test can reach the stack."""
        ready = self._folder / "ready"
        settings = {"ROS_LOG_DIR": str(self._folder / "ros_log")}
        with (
            own_domain(settings) as self.domain,
            self._run(("up", "--ready-file", str(ready), *self._rtf), ready.exists),
        ):
            yield self
