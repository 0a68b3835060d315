"""The machine and its serial adapters, as described by /dev, /sys, /proc and the udev rules."""

import grp
import os
import pwd
import stat
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from drivers.paths import resolved
from drivers.port.owners import command_line, open_files

RULE_FOLDERS: Final = ("usr/lib/udev/rules.d", "lib/udev/rules.d", "run/udev/rules.d", "etc/udev/rules.d")
"""Folders that contain udev rules. A file in a later folder replaces the file of the same name in an earlier folder."""


@dataclass(frozen=True, slots=True)
class User:
    """User of this process, with the groups of the current login."""

    name: str
    uid: int
    groups: frozenset[int]

    @classmethod
    def present(cls) -> "User":
        """Return the user of this process."""
        try:
            name = pwd.getpwuid(os.getuid()).pw_name
        except KeyError:  # A container's user may have no entry.
            name = str(os.getuid())
        return cls(name, os.geteuid(), frozenset((*os.getgroups(), os.getegid())))


@dataclass(frozen=True, slots=True)
class Holder:
    """A program that has a device open."""

    pid: int
    program: str
    """Command line of the program, shortened."""


@dataclass(frozen=True, slots=True)
class Machine:
    """This machine, or a simulated machine in tests."""

    root: Path = Path("/")
    """Folder that contains /dev, /sys, /proc and other system folders."""
    comports: Callable[[], Iterable[ListPortInfo]] = list_ports.comports
    """Function that lists the ports, as pyserial does."""
    user: User = field(default_factory=User.present)

    def path(self, device: str) -> Path:
        """Return the path of a device of this machine."""
        return self.root / device.lstrip("/")

    @property
    def sys_tty(self) -> Path:
        """Folder with the kernel's information about serial ports."""
        return self.root / "sys/class/tty"

    def by_id(self, device: str) -> str | None:
        """Return the link in /dev/serial/by-id, whose name stays the same when the device number changes."""
        path = resolved(self.path(device))
        links = sorted((self.root / "dev/serial/by-id").glob("*"))
        return next((f"/dev/serial/by-id/{link.name}" for link in links if resolved(link) == path), None)

    def holders(self, device: str) -> tuple[Holder, ...]:
        """Return the other programs that have the device open and are visible to this user."""
        mine, names = os.getpid(), {device, str(resolved(self.path(device)))}
        return tuple(
            Holder(pid, command_line(self.root / f"proc/{pid}"))
            for pid, _ in self._programs()
            if (pid != mine or self.root != Path("/")) and self._opened(pid) & names
        )

    def runs(self, program: str) -> bool:
        """Return whether a program with this name is running."""
        return any(name == program for _, name in self._programs())

    def udev_rules(self) -> dict[str, str]:
        """Return the active udev rules in lower case, without comments, keyed by file name. A masked rule file is
        returned as an empty string."""
        rules: dict[str, str] = {}
        for folder in RULE_FOLDERS:
            for file in sorted((self.root / folder).glob("*.rules")):
                rules[file.name] = _statements(file)
        return rules

    def usb_devices(self) -> Iterator[tuple[tuple[int, int], bool]]:
        """Yield the vendor and product ID of each USB device, and whether the kernel created a serial port for it."""
        for device in sorted((self.root / "sys/bus/usb/devices").glob("*")):
            try:
                numbers = tuple(int((device / name).read_text(), 16) for name in ("idVendor", "idProduct"))
            except (OSError, ValueError):  # An interface of a device, or a device that has disappeared.
                continue
            ports = [port for pattern in ("*:*/tty[A-Z]*", "*:*/tty/tty*") for port in device.glob(pattern)]
            yield (numbers[0], numbers[1]), bool(ports)

    def _programs(self) -> Iterator[tuple[int, str]]:
        for process in sorted((self.root / "proc").glob("[0-9]*"), key=lambda path: int(path.name)):
            try:
                yield int(process.name), (process / "comm").read_text().strip()
            except OSError:  # The process has ended.
                continue

    def _opened(self, pid: int) -> set[str]:
        return {path for _, path in open_files(self.root / f"proc/{pid}")}


def _statements(file: Path) -> str:
    try:
        lines = file.read_text(errors="replace").splitlines()
    except OSError:
        return ""
    return "\n".join(line.lower() for line in lines if not line.lstrip().startswith("#"))


USUAL_GROUP: Final = "dialout"
"""Group that owns serial devices on Debian and its derivatives. Joining this group is safer than running as root,
because a program that runs as root has far more permissions."""


@dataclass(frozen=True, slots=True)
class PortPermission:
    """The user's permission to open a device."""

    mode: str
    """Mode of the device, as an octal number for chmod."""
    group: str
    may_open: bool
    joined: bool
    """Whether the user has joined the group but has not logged in again since."""

    def advice(self, user: str) -> str | None:
        """Return the command that grants the user permission; None if the user already has permission."""
        if self.may_open:
            return None
        if self.joined:
            return f"newgrp {self.group}"
        return f"sudo usermod -aG {USUAL_GROUP if self.group == 'root' else self.group} {user}"


def permission(machine: Machine, device: str) -> PortPermission | None:
    """Return the user's permission for a device; None if the device has disappeared."""
    try:
        status = machine.path(device).stat()
    except OSError:
        return None
    group, members = _group(status.st_gid)
    may_open = _may_open(machine.user, status.st_uid, status.st_gid, status.st_mode)
    joined = not may_open and bool(status.st_mode & stat.S_IWGRP) and machine.user.name in members
    return PortPermission(f"{stat.S_IMODE(status.st_mode):04o}", group, may_open, joined)


def _may_open(user: User, owner: int, group: int, mode: int) -> bool:
    """Apply the kernel's rule: of owner, group and others, the first match decides. Root may open any device."""
    if user.uid == 0:
        return True
    if user.uid == owner:
        return mode & 0o600 == 0o600
    return mode & (0o060 if group in user.groups else 0o006) in (0o060, 0o006)


def _group(group_id: int) -> tuple[str, list[str]]:
    try:
        entry = grp.getgrgid(group_id)
    except KeyError:
        return str(group_id), []
    return entry.gr_name, entry.gr_mem
