"""Pseudo-terminals at fixed paths, like ``/dev/ttyACM0`` for a real adapter. Linux only."""

import contextlib
import fcntl
import logging
import os
import struct
import termios
import tty
from pathlib import Path
from typing import Final, Self

from drivers.driver_errors import PortBusy, PortError

LOG = logging.getLogger("servoloop.sim_backend")

TCGETS2: Final = 0x802C542A
TCSETS2: Final = 0x402C542B
_TERMIOS2: Final = struct.Struct("4IB19s2I")
_SPEED_BITS: Final = 0o010017
_ANY_SPEED: Final = 0o010000


class PtyLink:
    """Context manager that holds both ends of a pseudo-terminal and the symlink to the clients' end.

    An open handle on the clients' end keeps the pseudo-terminal open while clients connect and disconnect.
    """

    def __init__(self, link: Path, baud: int = 1_000_000) -> None:
        """Create the pseudo-terminal at ``link``. ``baud`` is the baud rate until a client sets a different one.

        Raises PortBusy if ``link`` exists, unless it was left behind by an emulator that has exited.
        """
        self.link = link
        self._make_room()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave, termios.TCSANOW)
        os.set_blocking(self._master, False)
        self.baud = baud
        self._target = os.ttyname(self._slave)
        try:
            os.symlink(self._target, link)
        except OSError as error:
            self.close()
            raise PortError(f"cannot create {link}: {error.strerror}") from error

    def _make_room(self) -> None:
        link = self.link
        if not link.parent.is_dir():
            raise PortError(f"{link.parent} is not a folder: create it, or choose another path")
        if link.is_symlink() and not link.exists():
            link.unlink()
        elif link.is_symlink():
            raise PortBusy(
                f"{link} points to {os.readlink(link)}, which another emulator seems to serve: "
                "stop that emulator, or remove the link if no emulator is running"
            )
        elif link.exists():
            raise PortBusy(f"{link} exists and is not an emulator's link: choose another path")

    def fileno(self) -> int:
        """Return the file descriptor of the servos' end of the pseudo-terminal, for select."""
        return self._master

    @property
    def baud(self) -> int:
        """Baud rate that the client has set. A pseudo-terminal stores the baud rate but does not limit the speed."""
        return int(_TERMIOS2.unpack(self._settings())[-1])

    @baud.setter
    def baud(self, value: int) -> None:
        iflag, oflag, cflag, lflag, line, cc, _, _ = _TERMIOS2.unpack(self._settings())
        cflag = cflag & ~_SPEED_BITS | _ANY_SPEED
        settings = _TERMIOS2.pack(iflag, oflag, cflag, lflag, line, cc, value, value)
        fcntl.ioctl(self._slave, TCSETS2, settings)

    def _settings(self) -> bytes:
        return fcntl.ioctl(self._slave, TCGETS2, bytes(_TERMIOS2.size))

    def read(self) -> bytes:
        """Read the bytes that clients have sent; return no bytes if there are none."""
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Send bytes to the clients. If the buffer is full, the bytes are lost, as on any serial port."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        """Close the pseudo-terminal, and remove the link if it has not been replaced since it was created."""
        with contextlib.suppress(OSError):  # If the folder has become read-only, the link remains and leads nowhere.
            if self.link.is_symlink() and os.readlink(self.link) == self._target:
                self.link.unlink()
        os.close(self._master)
        os.close(self._slave)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class PtyAdapter:
    """Context manager for the adapter of a virtual bus: a pseudo-terminal that can be unplugged and plugged in."""

    def __init__(self, link: Path) -> None:
        """Create an adapter. ``link`` is the path of the pseudo-terminal while the adapter is plugged in."""
        self.link = link
        self.line: PtyLink | None = None
        """The open pseudo-terminal; None while the adapter is unplugged."""

    def unplug(self) -> None:
        """Unplug the adapter. Clients are disconnected, and the link is removed."""
        if self.line is not None:
            self.line.close()
            self.line = None

    def plug(self, name: str | None = None) -> None:
        """Plug in the adapter at its own link, or in the same folder as ``name``. If the path is already in use or
        impossible, the adapter stays unplugged."""
        self.unplug()
        try:
            self.line = PtyLink(self.link if name is None else self.link.with_name(name))
        except (PortError, OSError, ValueError) as error:
            LOG.error("the adapter cannot be plugged in again: %s", error)

    @property
    def baud(self) -> int:
        """Baud rate that the client has set; 0 while the adapter is unplugged."""
        return 0 if self.line is None else self.line.baud

    def read(self) -> bytes:
        """Read the bytes that clients have sent; return no bytes if there are none."""
        return b"" if self.line is None else self.line.read()

    def write(self, data: bytes) -> None:
        """Send bytes to the clients."""
        if self.line is not None:
            self.line.write(data)

    def __enter__(self) -> Self:
        self.line = PtyLink(self.link)
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()
