"""The machine as far as serial adapters are concerned: what /dev, /sys, /proc and udev's rules say."""

import os
import pwd
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
