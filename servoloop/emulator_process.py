"""The emulator of ``servoloop up`` without a port: a process of its own."""

import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from drivers.clock import MonotonicClock
from drivers.errors import DriverError
from servoloop.ports import device_paths
from servoloop.processes import LOOK_S, Interrupted, end, end_with_parent
from sim_backend.scene.world_feed import feed_path

START_S: Final = 30.0
END_S: Final = 10.0
"""It draws no pictures."""


@contextmanager
def emulator_process(
    link: Path, *arguments: str, buses: Iterable[str] = ("",), signals: Callable[[], int] = lambda: 0
) -> Iterator[None]:
    """Start an emulator process; it ends with this process, however this one ends.

    ``buses``: the names of those that it serves. ``signals``: how many there were; one ends the wait for the emulator
    with Interrupted, two kill the emulator.
    """
    command = [sys.executable, "-m", "servoloop", "emulate", str(link), *arguments]
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for the stack: it still needs its arm to stop it
        preexec_fn=end_with_parent,
    )
    try:
        _wait_for(link, list(device_paths(link, buses).values()), process, signals)
        yield
    finally:
        end(process, END_S, lambda: signals() > 1)


def _wait_for(
    link: Path, places: Sequence[Path], process: "subprocess.Popen[bytes]", signals: Callable[[], int]
) -> None:
    clock = MonotonicClock()
    deadline_s = clock.now() + START_S
    while not all(path.exists() for path in (*places, feed_path(link))):
        if process.poll() is not None:
            raise DriverError(f"the emulator ended at once (status {process.returncode})")
        if signals():
            raise Interrupted("interrupted while starting the virtual servos")
        if clock.now() > deadline_s:
            raise DriverError(f"the emulator did not serve {link} within {START_S:.0f} s")
        clock.sleep_until(clock.now() + LOOK_S)
