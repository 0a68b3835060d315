"""Virtual servos for a verb that is started without a port: ``servoloop emulate`` as a child process."""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from drivers.clock import MonotonicClock
from drivers.errors import DriverError
from servoloop.stack.devices import device_paths
from servoloop.stack.processes import LOOK_S, Interrupted, end, end_with_parent
from servoloop.stack.robot_files import ServoFiles
from sim_backend.scene.world_feed import feed_path

START_S: Final = 60.0
END_S: Final = 10.0
"""It draws no pictures."""


def emulate_arguments(link: Path, files: ServoFiles) -> tuple[str, ...]:
    """The arguments of ``servoloop`` by which a child process serves exactly the arm of these files."""
    return ("emulate", str(link), *files.servo_options)


@contextmanager
def virtual_servos(files: ServoFiles, signals: Callable[[], int] = lambda: 0) -> Iterator[dict[str, str]]:
    """Serve the arm's servos from a child process, which ends with this process; yields the devices by bus.

    ``signals``: number of signals so far. One ends the wait for the emulator with Interrupted, two kill the emulator.
    """
    with tempfile.TemporaryDirectory(prefix="servoloop-") as folder:
        link = Path(folder) / "bus"
        places = device_paths(link, files.robot.file.lines())
        process = subprocess.Popen(
            [sys.executable, "-m", "servoloop", *emulate_arguments(link, files)],
            stdout=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the stack: it still needs its arm to stop it
            preexec_fn=end_with_parent,
        )
        try:
            _wait_for(link, list(places.values()), process, signals)
            yield {name: str(path) for name, path in places.items()}
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
