"""Choose the devices of a stack.

The devices are the given ports, or virtual servos that ``servoloop emulate`` serves in a child process.
"""

import logging
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from drivers.clock import MonotonicClock
from drivers.driver_errors import DriverError
from servoloop.extras import require_extras
from servoloop.stack import hardware
from servoloop.stack.devices import device_paths
from servoloop.stack.hardware import HardwareKind
from servoloop.stack.processes import POLL_S, Interrupted, end, start_child
from servoloop.stack.robot_files import Files, ServoFiles
from sim_backend.scene.world_feed import feed_path

LOG = logging.getLogger("servoloop")

START_S: Final = 300.0
"""Maximum time for the emulator to start, in seconds.

The simulation is compiled at the first start after an installation. The compilation takes 20 s, or several minutes on a
slow or busy machine.
"""
END_S: Final = 10.0
"""Maximum time for the emulator to end, in seconds. An emulator in a child process does not render images."""


def emulate_arguments(link: Path, files: ServoFiles) -> tuple[str, ...]:
    """Return the ``servoloop`` arguments for a child process that emulates the arm described by these files."""
    return ("emulate", str(link), *files.servo_options)


@contextmanager
def virtual_servos(files: ServoFiles, signals: Callable[[], int] = lambda: 0) -> Iterator[dict[str, str]]:
    """Run the servos of an arm in a child process that ends with this process.

    Args:
        files: Files of the arm.
        signals: Function that returns the number of signals received so far. The first signal interrupts the start of
            the emulator; the second signal kills the emulator.

    Yields:
        Device paths, keyed by bus name.

    Raises:
        Interrupted: A signal arrived before the emulator was ready.
        DriverError: The emulator did not start.
        ExtraError: The extra ``sim`` is not installed.
    """
    require_extras("the simulation of the servos", "sim")
    with tempfile.TemporaryDirectory(prefix="servoloop-") as folder:
        link = Path(folder) / "bus"
        places = device_paths(link, files.robot.file.lines())
        process = start_child(
            [sys.executable, "-m", "servoloop", *emulate_arguments(link, files)],
            stdout=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C must not end the emulator, which the stack still needs to stop the arm
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
            raise DriverError(f"the virtual servos could not start (exit status {process.returncode})")
        if signals():
            raise Interrupted("interrupted while starting the virtual servos")
        if clock.now() > deadline_s:
            raise DriverError(
                f"the virtual servos were not ready within {START_S:g} s: stop other programs that use the processor, "
                "then start the command again"
            )
        clock.sleep_until(clock.now() + POLL_S)


@contextmanager
def chosen_devices(
    kind: HardwareKind | None,
    ports: Mapping[str, str] | None,
    files: Files,
    signals: Callable[[], int] = lambda: 0,
) -> Iterator[Mapping[str, str]]:
    """Provide the devices of a stack for the duration of the context.

    Args:
        kind: Hardware type of all components. If None, the ``<plugin>`` of each component selects its hardware.
        ports: Devices, keyed by bus name. If None, virtual servos are used if a component needs servos.
        files: Files of the robot.
        signals: Function that returns the number of signals received so far, as for ``virtual_servos``.

    Yields:
        Device paths, keyed by bus name.

    Raises:
        DriverError: No component uses the ports, or the emulator did not start.
        ExtraError: The extra ``sim`` is not installed.
    """
    kinds = [hardware.choose(kind, component) for component in files.description.components]
    if HardwareKind.SERVOS not in kinds and ports:
        raise DriverError("--port was given, but no component uses servos: omit --port or --hardware")
    if HardwareKind.SERVOS not in kinds or ports is not None:
        yield ports or {}
        return
    with virtual_servos(files, signals) as devices:
        yield devices
    LOG.info("the virtual servos have been shut down")
