"""Virtual servos for other programs: a bus on a pseudo-terminal, and the ROS stack, each in a process of its own."""

import fcntl
import os
import random
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from drivers.clock import MonotonicClock
from drivers.errors import DriverError
from nodes.discovery import stay_on_this_machine

DOMAINS = range(1, 98, 4)
"""From 102 on they can meet the ports that Linux hands out; a run may use the next two as well."""


@contextmanager
def free_domain() -> Iterator[int]:
    """One that no other run on this machine has: the lock on its file ends with the process, however that ends."""
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
    """A free domain on this machine alone, in the environment with these ``settings`` until the end of the block."""
    with free_domain() as domain:
        said = {"ROS_DOMAIN_ID": str(domain), **settings}
        stay_on_this_machine(said)
        before = {name: os.environ.get(name) for name in said}
        os.environ.update(said)
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
LOOK_S = 0.02


class ProcessTestError(DriverError):
    """A process of servoloop that did not start; its last words."""


class _Process:
    """``servoloop`` with these arguments, from ``ready`` on until the end of the block."""

    def __init__(self, files: Mapping[str, Any], folder: Path) -> None:
        self.log = folder / "servoloop.log"
        """What it printed."""
        self._files = [text for name, value in files.items() for text in (f"--{name}", str(value))]
        self._folder = folder

    @contextmanager
    def _run(self, verb: Sequence[str], ready: Path) -> Iterator[None]:
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

    def _wait_for(self, ready: Path, process: "subprocess.Popen[bytes]") -> None:
        clock = MonotonicClock()
        deadline_s = clock.now() + START_S
        while not ready.exists():
            if process.poll() is not None or clock.now() > deadline_s:
                raise ProcessTestError(f"servoloop did not start:\n{self.log.read_text(errors='replace')}")
            clock.sleep_until(clock.now() + LOOK_S)


class VirtualBus(_Process):
    """``servoloop emulate``: ``port`` takes any client that takes a serial port."""

    def __init__(
        self, files: Mapping[str, Any], folder: Path, seed: int | None = None, backlash_deg: float = 1.0
    ) -> None:
        super().__init__({name: path for name, path in files.items() if name != "controllers"}, folder)
        self.port = str(folder / "bus")
        """The path of the serial port; several buses: this and ``.NAME`` each."""
        self._seed = () if seed is None else ("--seed", str(seed))
        self._backlash = ("--backlash", str(backlash_deg))

    @contextmanager
    def running(self) -> Iterator[Self]:
        """Serve it until the end of the block."""
        from sim_backend.scene.world_feed import feed_path

        with self._run(("emulate", self.port, *self._seed, *self._backlash), feed_path(Path(self.port))):
            yield self

    def fault(self, text: str) -> None:
        """Have a fault happen, such as ``silent id=3 for=2s``. Raises ValueError where it cannot."""
        from sim_backend.control import ask, control_path

        ask(control_path(Path(self.port)), {"do": "fault", "text": text})


class RosStack(_Process):
    """``servoloop up`` with virtual servos, in a ROS domain of its own, which is the test's too."""

    def __init__(self, files: Mapping[str, Any], folder: Path, rtf: float | str | None = None) -> None:
        super().__init__(files, folder)
        self.domain = -1
        """Its ROS_DOMAIN_ID, set in ``os.environ`` too while it runs."""
        self._rtf = () if rtf is None else ("--rtf", str(rtf))

    @contextmanager
    def running(self) -> Iterator[Self]:
        """Have it up until the end of the block. Nodes that the test makes find it; so do processes it starts."""
        ready = self._folder / "ready"
        settings = {"ROS_LOG_DIR": str(self._folder / "ros_log")}
        with own_domain(settings) as self.domain, self._run(("up", "--ready-file", str(ready), *self._rtf), ready):
            yield self
