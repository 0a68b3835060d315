"""Choose the devices of a stack: the given ports, or virtual servos in a child process."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from drivers.errors import DriverError
from servoloop.stack import hardware
from servoloop.stack.emulator_process import virtual_servos
from servoloop.stack.hardware import HardwareKind
from servoloop.stack.robot_files import Files

LOG = logging.getLogger("servoloop")


@contextmanager
def chosen_devices(
    kind: HardwareKind | None,
    ports: Mapping[str, str] | None,
    files: Files,
    signals: Callable[[], int] = lambda: 0,
) -> Iterator[Mapping[str, str]]:
    """Provide the devices of a stack for the duration of the context.

    Args:
        kind: Hardware of all components. None: the ``<plugin>`` of each component decides.
        ports: Devices by bus. None: virtual servos, if a component uses servos.
        files: Files of the robot.
        signals: Function that returns the number of signals received so far, as for ``virtual_servos``.

    Yields:
        Device paths by bus name.

    Raises:
        DriverError: No component uses the ports, or the emulator did not start.
        ExtraError: The extra ``sim`` is not installed.
    """
    kinds = [hardware.choose(kind, component) for component in files.description.components]
    if HardwareKind.SERVOS not in kinds and ports:
        raise DriverError("--port was given, but no component uses servos: leave out --port or --hardware")
    if HardwareKind.SERVOS not in kinds or ports is not None:
        yield ports or {}
        return
    with virtual_servos(files, signals) as devices:
        yield devices
    LOG.info("the virtual servos have been shut down")
