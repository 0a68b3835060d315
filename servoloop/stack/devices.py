"""Select the device paths of the buses from the command line or from an emulator."""

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from drivers.driver_errors import DriverError
from sim_backend.scene.world_feed import feed_path

VIRTUAL = "virtual"


def parse_ports(values: Sequence[str], buses: Iterable[str]) -> dict[str, str] | None:
    """Return the device of each bus from the ``--port`` options, or None for virtual servos.

    Args:
        values: Values of ``--port``: ``PATH`` for a robot with one bus, otherwise ``NAME=PATH`` for each bus, in one
            value with commas or in several.
        buses: Names of the buses in the robot file.

    Raises:
        DriverError: The options do not match the buses.
    """
    names = list(buses)
    values = [part for value in values for part in re.split(r",(?=[^/=,]+=)", value)]
    if list(values) in ([], [VIRTUAL]):
        return None
    if len(names) == 1 and len(values) == 1:
        path = values[0].removeprefix(f"{names[0]}=") if names[0] else values[0]
        other, named, device = path.partition("=")
        if named and "/" not in other and other:
            known = f"is named {names[0]}" if names[0] else "has no name"
            raise DriverError(f"--port {path} names the bus {other}, but the only bus {known}: use --port {device}")
        if not Path(path).name:
            raise DriverError(f"--port needs the path of a device, such as /dev/ttyACM0, not {path!r}")
        return {names[0]: path}
    if len(names) == 1:
        raise DriverError("the robot has only one bus: pass only one --port")
    devices: dict[str, str] = {}
    problems: list[str] = []
    for value in values:
        name, sign, path = value.partition("=")
        if not sign or not Path(path).name or name not in names:
            problems.append(f"--port {value} does not specify a bus")
        elif name in devices:
            problems.append(f"--port {name}= is given twice")
        devices.setdefault(name, path)
    problems += [f"bus {name} has no --port" for name in names if name not in devices]
    paths = list(devices.values())
    problems += [f"two buses cannot share {path}" for path in dict.fromkeys(paths) if path and paths.count(path) > 1]
    if problems:
        wanted = " ".join(f"--port {name}=PATH" for name in names)
        raise DriverError(f"{'; '.join(problems)}. The robot file has the buses {', '.join(names)}: use {wanted}")
    return devices


def device_paths(link: Path, buses: Iterable[str]) -> dict[str, Path]:
    """Return the path at which an emulator serves each bus: ``link``, or ``link``.NAME if the buses are named."""
    return {name: link.with_name(f"{link.name}.{name}") if name else link for name in buses}


def port_options(link: Path, buses: Iterable[str]) -> list[str]:
    """Return the ``--port`` options that connect a stack to an emulator at ``link``."""
    served = device_paths(link, buses).items()
    return [argument for name, path in served for argument in ("--port", f"{name}={path}" if name else str(path))]


def world_feed(devices: Mapping[str, str]) -> Path | None:
    """Return the path of the emulator's world feed for these devices, or None for a real bus."""
    for name, device in devices.items():
        link = Path(device)
        base = link.with_name(link.name.removesuffix(f".{name}")) if name else link
        with suppress(OSError):  # opening the device reports a path that cannot be accessed
            if feed_path(base).is_socket():
                return feed_path(base)
    return None
