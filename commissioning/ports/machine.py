"""The machine as far as serial adapters are concerned: what /dev, /sys, /proc and udev's rules say."""

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

RULE_FOLDERS: Final = ("usr/lib/udev/rules.d", "lib/udev/rules.d", "run/udev/rules.d", "etc/udev/rules.d")
"""In udev's order: a file of the same name in a later one replaces that in an earlier one."""


@dataclass(frozen=True, slots=True)
class User:
    """Who runs this program, and the groups that the program really has: those of its login."""

    name: str
    uid: int
    groups: frozenset[int]

    @classmethod
    def present(cls) -> "User":
        """The user of this process."""
        try:
            name = pwd.getpwuid(os.getuid()).pw_name
        except KeyError:  # a container's user without an entry
            name = str(os.getuid())
        return cls(name, os.geteuid(), frozenset((*os.getgroups(), os.getegid())))


@dataclass(frozen=True, slots=True)
class Holder:
    """A program that has a device open."""

    pid: int
    program: str


@dataclass(frozen=True, slots=True)
class Machine:
    """``root`` stands above /dev, /sys and the others. ``comports`` lists the ports as pyserial does."""

    root: Path = Path("/")
    comports: Callable[[], Iterable[ListPortInfo]] = list_ports.comports
    user: User = field(default_factory=User.present)

    def path(self, device: str) -> Path:
        """Where a device of this machine is."""
        return self.root / device.lstrip("/")

    @property
    def sys_tty(self) -> Path:
        """The folder with what the kernel says of its terminals."""
        return self.root / "sys/class/tty"

    def by_id(self, device: str) -> str | None:
        """The link in /dev/serial/by-id, whose name stays when numbers change."""
        path = self.path(device).resolve()
        links = sorted((self.root / "dev/serial/by-id").glob("*"))
        return next((f"/dev/serial/by-id/{link.name}" for link in links if link.resolve() == path), None)

    def holders(self, device: str) -> tuple[Holder, ...]:
        """The other programs that have the device open, as far as we may look into them."""
        mine, names = os.getpid(), {device, str(self.path(device).resolve())}
        return tuple(
            Holder(pid, name)
            for pid, name in self._programs()
            if (pid != mine or self.root != Path("/")) and self._opened(pid) & names
        )

    def runs(self, program: str) -> bool:
        """Whether a program of this name is running."""
        return any(name == program for _, name in self._programs())

    def udev_rules(self) -> dict[str, str]:
        """The rules in force, by file: without comments, lower case. A masked file is empty."""
        rules: dict[str, str] = {}
        for folder in RULE_FOLDERS:
            for file in sorted((self.root / folder).glob("*.rules")):
                rules[file.name] = _statements(file)
        return rules

    def usb_devices(self) -> Iterator[tuple[tuple[int, int], bool]]:
        """Vendor and product number of each USB device, and whether the kernel has made a serial port of it."""
        for device in sorted((self.root / "sys/bus/usb/devices").glob("*")):
            try:
                numbers = tuple(int((device / name).read_text(), 16) for name in ("idVendor", "idProduct"))
            except (OSError, ValueError):  # an interface, or gone
                continue
            ports = [port for pattern in ("*:*/tty[A-Z]*", "*:*/tty/tty*") for port in device.glob(pattern)]
            yield (numbers[0], numbers[1]), bool(ports)

    def _programs(self) -> Iterator[tuple[int, str]]:
        for process in sorted((self.root / "proc").glob("[0-9]*"), key=lambda path: int(path.name)):
            try:
                yield int(process.name), (process / "comm").read_text().strip()
            except OSError:  # ended meanwhile
                continue

    def _opened(self, pid: int) -> set[str]:
        try:
            return {os.readlink(fd) for fd in (self.root / f"proc/{pid}/fd").iterdir()}
        except OSError:  # ended meanwhile, or another user's
            return set()


def _statements(file: Path) -> str:
    try:
        lines = file.read_text(errors="replace").splitlines()
    except OSError:
        return ""
    return "\n".join(line.lower() for line in lines if not line.lstrip().startswith("#"))


USUAL_GROUP: Final = "dialout"
"""Of serial devices on Debian and its relatives. Whoever joins the group root may do far more than open ports."""


@dataclass(frozen=True, slots=True)
class Permission:
    """``mode`` as chmod writes it. ``joined``: the user is in the group, but not yet in this login."""

    mode: str
    group: str
    may_open: bool
    joined: bool

    def advice(self, user: str) -> str | None:
        """The command; None for a user who may."""
        if self.may_open:
            return None
        if self.joined:
            return f"newgrp {self.group}"
        return f"sudo usermod -aG {USUAL_GROUP if self.group == 'root' else self.group} {user}"


def permission(machine: Machine, device: str) -> Permission | None:
    """What the device's owner, group and mode let the user do; None where it is gone."""
    try:
        status = machine.path(device).stat()
    except OSError:
        return None
    group, members = _group(status.st_gid)
    may_open = _may_open(machine.user, status.st_uid, status.st_gid, status.st_mode)
    joined = not may_open and bool(status.st_mode & stat.S_IWGRP) and machine.user.name in members
    return Permission(f"{stat.S_IMODE(status.st_mode):04o}", group, may_open, joined)


def _may_open(user: User, owner: int, group: int, mode: int) -> bool:
    """The kernel's own rule: the first that fits decides. Root may always."""
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
