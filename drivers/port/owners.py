"""Who holds a serial device: a program that does not lock it is seen only in the process table."""

import os
from collections.abc import Iterator
from pathlib import Path

PSEUDO_TERMINALS = Path("/dev/pts")


def port_owners(path: Path) -> Iterator[str]:
    """Names of the other processes that hold the device open, as far as we may look."""
    device = path.resolve()
    for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda p: int(p.name)):
        if int(process.name) != os.getpid() and _holds(process, device) and not _serves(process, device):
            yield f"{_command(process)} (process {process.name})"


def held_by_us(path: Path) -> bool:
    """Whether this process has the device open."""
    return _holds(Path("/proc/self"), path.resolve())


def is_pseudo_terminal(path: Path) -> bool:
    """Whether a program is at the far end, and no adapter."""
    return path.resolve().parent == PSEUDO_TERMINALS


def _holds(process: Path, device: Path) -> bool:
    try:
        return any(Path(os.readlink(fd)) == device for fd in (process / "fd").iterdir())
    except OSError:  # ended meanwhile, or another user's
        return False


def _serves(process: Path, device: Path) -> bool:
    """Whether the process is the far end of this pseudo-terminal: an emulator keeps both ends open."""
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
    """Return the parts of a line to check: the plugs, or on a pseudo-terminal the program that serves it."""
    if is_pseudo_terminal(Path(device)):
        return "the program that serves this virtual line, the faults set in it and the load of this machine"
    return plugs
