"""Find the processes that have a serial device open.

Only the process table shows programs that do not lock the device.
"""

import os
from collections.abc import Iterator
from pathlib import Path

from drivers.paths import resolved

PSEUDO_TERMINALS = Path("/dev/pts")


def port_owners(path: Path) -> Iterator[str]:
    """Yield the names of other processes that have the device open. Processes that belong to other users may be
    hidden."""
    device = resolved(path)
    for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda p: int(p.name)):
        if int(process.name) != os.getpid() and _has_open(process, device) and not _serves(process, device):
            yield f"{_command(process)} (process {process.name})"


def held_by_us(path: Path) -> bool:
    return _has_open(Path("/proc/self"), resolved(path))


def is_pseudo_terminal(path: Path) -> bool:
    """Return whether the device is a pseudo-terminal, which is served by a program instead of an adapter."""
    return resolved(path).parent == PSEUDO_TERMINALS


def _has_open(process: Path, device: Path) -> bool:
    try:
        return any(Path(os.readlink(fd)) == device for fd in (process / "fd").iterdir())
    except OSError:  # the process has ended, or belongs to another user
        return False


def _serves(process: Path, device: Path) -> bool:
    """Return whether the process serves this pseudo-terminal. An emulator keeps both ends open."""
    if not is_pseudo_terminal(device):
        return False
    try:
        ends = [fd for fd in (process / "fd").iterdir() if os.readlink(fd).endswith("/ptmx")]
        infos = [(process / "fdinfo" / fd.name).read_text() for fd in ends]
    except OSError:
        return False
    return any(line.split() == ["tty-index:", device.name] for info in infos for line in info.splitlines())


def _command(process: Path) -> str:
    try:
        return (process / "comm").read_text().strip()
    except OSError:
        return "a program"


def line_advice(device: str, plugs: str = "the cable's plugs") -> str:
    """Return what to check on a bus: the plugs or, for a pseudo-terminal, the program that serves it."""
    if is_pseudo_terminal(Path(device)):
        return "the program that serves this virtual bus, its injected faults and the load of this machine"
    return plugs
