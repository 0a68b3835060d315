"""Find the processes that have a serial device open.

Only the process table shows programs that do not lock the device.
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from drivers.paths import resolved
from drivers.printable import printable_line

PSEUDO_TERMINALS = Path("/dev/pts")
LONGEST_COMMAND: Final = 80
"""Maximum number of characters of a command line in a message."""


def port_owners(path: Path) -> Iterator[str]:
    """Yield the command lines of other processes that have the device open. Processes that belong to other users may be
    hidden."""
    device = resolved(path)
    for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda p: int(p.name)):
        if int(process.name) != os.getpid() and _has_open(process, device) and not _serves(process, device):
            yield f"{command_line(process)} (process {process.name})"


def held_by_us(path: Path) -> bool:
    return _has_open(Path("/proc/self"), resolved(path))


def is_pseudo_terminal(path: Path) -> bool:
    """Return whether the device is a pseudo-terminal, which is served by a program instead of an adapter."""
    return resolved(path).parent == PSEUDO_TERMINALS


def open_files(process: Path) -> Iterator[tuple[str, str]]:
    """Yield the open file descriptors of a process and the paths that they refer to.

    Descriptors that are closed during the call are skipped. Processes of other users have no visible descriptors.

    Args:
        process: Folder of the process in /proc.
    """
    try:
        names = os.listdir(process / "fd")
    except OSError:  # the process has ended, or belongs to another user
        return
    for name in names:
        with suppress(OSError):
            yield name, os.readlink(process / "fd" / name)


def command_line(process: Path) -> str:
    """Return the command line of a process as one short line, without the folder of the program.

    Args:
        process: Folder of the process in /proc.
    """
    try:
        program, *arguments = (process / "cmdline").read_text(errors="replace").rstrip("\0").split("\0")
        words = [Path(program).name, *arguments] if program else [(process / "comm").read_text().strip()]
    except OSError:
        return "a program"
    line = printable_line(" ".join(words))
    return line if len(line) <= LONGEST_COMMAND else f"{line[:LONGEST_COMMAND]}…"


def _has_open(process: Path, device: Path) -> bool:
    return any(path == str(device) for _, path in open_files(process))


def _serves(process: Path, device: Path) -> bool:
    """Return whether the process serves this pseudo-terminal. An emulator keeps both ends open."""
    if not is_pseudo_terminal(device):
        return False
    ends = [name for name, path in open_files(process) if path.endswith("/ptmx")]
    return any(["tty-index:", device.name] in _info(process / "fdinfo" / name) for name in ends)


def _info(file: Path) -> list[list[str]]:
    """Return the words of each line of a file in /proc/PID/fdinfo. The result is empty if the descriptor was closed."""
    try:
        return [line.split() for line in file.read_text().splitlines()]
    except OSError:
        return []


def line_advice(device: str, plugs: str = "the cable's plugs") -> str:
    """Return what to check on a bus: the plugs or, for a pseudo-terminal, the program that serves it."""
    if is_pseudo_terminal(Path(device)):
        return "the program that serves this virtual bus, its injected faults and the load of this machine"
    return plugs
