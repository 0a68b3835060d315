"""Simulated machines in a folder, with /dev, /sys and /proc."""

import os
from collections.abc import Sequence
from pathlib import Path

from serial.tools.list_ports_common import ListPortInfo

from commissioning.ports.machine import Machine, User

STRANGER = User("stranger", 4711, frozenset())
OWNER = User("owner", os.getuid() or 1, frozenset({os.getgid()}))
BRLTTY_RULES = """# a comment that names 10c4/ea60
ENV{PRODUCT}=="1a86/7523/*", ENV{BRLTTY_BRAILLE_DRIVER}="bm", GOTO="brltty_usb_run"
"""


class SmallMachine:
    """A machine with the adapters that were added by ``plug``."""

    def __init__(self, root: Path, user: User = OWNER) -> None:
        self.root = root
        self.infos: list[ListPortInfo] = []
        self.machine = Machine(root, lambda: list(self.infos), user)

    def plug(
        self, device: str, vid: int = 0x1A86, pid: int = 0x55D3, serial: str | None = "5A46", mode: int = 0o660
    ) -> ListPortInfo:
        """Add an adapter with its device, its by-id link and its entry in /sys."""
        info = ListPortInfo(device)
        info.vid, info.pid, info.serial_number, info.product = vid, pid, serial, "USB Single Serial"
        self.infos.append(info)
        node = self.file(device, "")
        node.chmod(mode)
        if serial is not None:
            link = self.root / f"dev/serial/by-id/usb-{serial}-if00"
            link.parent.mkdir(parents=True, exist_ok=True)
            link.unlink(missing_ok=True)
            link.symlink_to(f"../../{node.name}")
        self.usb(f"1-{len(self.infos)}", vid, pid, node.name)
        return info

    def usb(self, name: str, vid: int, pid: int, port: str | None) -> None:
        """Add a USB device to /sys."""
        self.file(f"sys/bus/usb/devices/{name}/idVendor", f"{vid:04x}\n")
        self.file(f"sys/bus/usb/devices/{name}/idProduct", f"{pid:04x}\n")
        place = f"{name}:1.0/tty/{port}" if port and "ACM" in port else f"{name}:1.0/{port}"
        (self.root / "sys/bus/usb/devices" / name / (place if port else f"{name}:1.0")).mkdir(parents=True)

    def latency(self, device: str, latency_ms: int) -> None:
        """Add the latency timer of an FTDI adapter."""
        self.file(f"sys/class/tty/{Path(device).name}/device/latency_timer", f"{latency_ms}\n")

    def run(self, pid: int, program: str, opened: Sequence[str] = ()) -> None:
        """Add a running program with open files."""
        self.file(f"proc/{pid}/comm", f"{program}\n")
        folder = self.root / f"proc/{pid}/fd"
        folder.mkdir()
        for number, path in enumerate(opened, 3):
            (folder / str(number)).symlink_to(path)

    def file(self, path: str, text: str) -> Path:
        """Write a file below the root."""
        file = self.root / path.lstrip("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file
