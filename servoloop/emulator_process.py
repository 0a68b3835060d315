"""An emulator in a process of its own."""

import ctypes
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from drivers.clock import MonotonicClock
from drivers.errors import DriverError
from servoloop.ports import links
from sim_backend.world_feed import feed_path

START_S = 30.0
_PR_SET_PDEATHSIG = 1


@contextmanager
def emulator_process(link: Path, *arguments: str, buses: Iterable[str] = ("",)) -> Iterator[None]:
    """An emulator in a process of its own, that ends with this one, however this one ends.

    ``buses``: the names of those that it serves.
    """
    command = [sys.executable, "-m", "servoloop", "emulate", str(link), *arguments]
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for the stack: it still needs its arm to stop it
        preexec_fn=_end_with_parent,
    )
    try:
        _wait_for(link, list(links(link, buses).values()), process)
        yield
    finally:
        process.terminate()
        process.wait()


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _wait_for(link: Path, places: Sequence[Path], process: "subprocess.Popen[bytes]") -> None:
    clock = MonotonicClock()
    deadline_s = clock.now() + START_S
    while not all(path.exists() for path in (*places, feed_path(link))):
        if process.poll() is not None:
            raise DriverError(f"the emulator ended at once (status {process.returncode})")
        if clock.now() > deadline_s:
            raise DriverError(f"the emulator did not serve {link} within {START_S:.0f} s")
        clock.sleep_until(clock.now() + 0.02)
