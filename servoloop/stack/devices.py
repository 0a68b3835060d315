"""The devices of the buses: what the command line says, and where an emulator serves."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from drivers.errors import DriverError
from sim_backend.scene.world_feed import feed_path

VIRTUAL = "virtual"


def parse_ports(values: Sequence[str], buses: Iterable[str]) -> dict[str, str] | None:
    """Parse ``--port``: devices by bus, from ``PATH`` (one bus) or ``NAME=PATH`` each; None for virtual servos."""
    names = list(buses)
    if list(values) in ([], [VIRTUAL]):
        return None
    if len(names) == 1 and len(values) == 1:
        path = values[0].removeprefix(f"{names[0]}=") if names[0] else values[0]
        if not Path(path).name:
            raise DriverError(f"--port takes a device such as /dev/ttyACM0, not {path!r}")
        return {names[0]: path}
    if len(names) == 1:
        raise DriverError("the robot has one bus: name one --port")
    devices: dict[str, str] = {}
    problems: list[str] = []
    for value in values:
        name, sign, path = value.partition("=")
        if not sign or not Path(path).name or name not in names:
            problems.append(f"--port {value} names none of the buses")
        elif name in devices:
            problems.append(f"--port {name}= is there twice")
        devices.setdefault(name, path)
    problems += [f"no --port for bus {name}" for name in names if name not in devices]
    paths = list(devices.values())
    problems += [f"two buses cannot share {path}" for path in dict.fromkeys(paths) if path and paths.count(path) > 1]
    if problems:
        wanted = " ".join(f"--port {name}=PATH" for name in names)
        raise DriverError(f"{'; '.join(problems)}. The robot file has the buses {', '.join(names)}: say {wanted}")
    return devices


def device_paths(link: Path, buses: Iterable[str]) -> dict[str, Path]:
    """The path at which an emulator serves each bus: ``link`` itself, or at ``link``.NAME where buses have names."""
    return {name: link.with_name(f"{link.name}.{name}") if name else link for name in buses}


def port_options(link: Path, buses: Iterable[str]) -> list[str]:
    """The options that bring a stack up on an emulator at ``link``."""
    served = device_paths(link, buses).items()
    return [word for name, path in served for word in ("--port", f"{name}={path}" if name else str(path))]


def world_feed(devices: Mapping[str, str]) -> Path | None:
    """The path of the feed of the emulator behind these devices; None for a real line, which has no such thing."""
    for name, device in devices.items():
        link = Path(device)
        base = link.with_name(link.name.removesuffix(f".{name}")) if name else link
        if feed_path(base).is_socket():
            return feed_path(base)
    return None
