"""A pseudo-terminal at a path of its own, as ``/dev/ttyACM0`` is for an adapter. Linux only."""

import contextlib
import fcntl
import logging
import os
import struct
import termios
import tty
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from drivers.errors import PortBusy, PortError

LOG = logging.getLogger("servoloop.sim_backend")

TCGETS2: Final = 0x802C542A
TCSETS2: Final = 0x402C542B
_TERMIOS2: Final = struct.Struct("4IB19s2I")
_SPEED_BITS: Final = 0o010017
_ANY_SPEED: Final = 0o010000


class PtyLink:
    """Both ends of a pseudo-terminal and the symlink to the clients' end; a context manager.

    Our own handle on the clients' end keeps the line up while clients come and go.
    """

    def __init__(self, link: Path, baud: int = 1_000_000) -> None:
        """Put the line at ``link``; ``baud`` is its speed until a client sets another.

        Raises PortBusy if something is there that is not the remains of an ended emulator.
        """
        self.link = link
        self._make_room()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave, termios.TCSANOW)
        os.set_blocking(self._master, False)
        self.baud = baud
        self._target = os.ttyname(self._slave)
        os.symlink(self._target, link)

    def _make_room(self) -> None:
        link = self.link
        if not link.parent.is_dir():
            raise PortError(f"{link.parent} is not a folder: make it, or choose another path")
        if link.is_symlink() and not link.exists():
            link.unlink()
        elif link.is_symlink():
            raise PortBusy(
                f"{link} leads to {os.readlink(link)}: another emulator seems to serve it; "
                "end that one, or remove the link if nothing does"
            )
        elif link.exists():
            raise PortBusy(f"{link} exists and is no emulator's link: choose another path")

    def fileno(self) -> int:
        """The servos' end, for select."""
        return self._master

    @property
    def baud(self) -> int:
        """Bits per second as the client set them; a pseudo-terminal carries the number, no more."""
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
        """What a client has sent; empty when there is nothing."""
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Send to whoever listens. What finds the buffer full is lost, as on any line."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        """Take the line away, and the link if it is still ours."""
        if self.link.is_symlink() and os.readlink(self.link) == self._target:
            self.link.unlink()
        os.close(self._master)
        os.close(self._slave)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class PtyAdapter:
    """The adapter of a virtual line: a pseudo-terminal that can be pulled out and put back; a context manager."""

    def __init__(self, link: Path) -> None:
        """``link``: where the line is while the adapter is there."""
        self.link = link
        self.line: PtyLink | None = None
        """None while it is not there."""

    def unplug(self) -> None:
        """Pull it: clients lose the line, and the link is gone."""
        if self.line is not None:
            self.line.close()
            self.line = None

    def plug(self, name: str | None = None) -> None:
        """Put it back at its link, or beside that under ``name``; where something else is, it stays away."""
        self.unplug()
        try:
            self.line = PtyLink(self.link if name is None else self.link.with_name(name))
        except PortError as error:
            LOG.error("the adapter does not come back: %s", error)

    @property
    def baud(self) -> int:
        """As ``PtyLink`` has it; 0 as long as nobody is there."""
        return 0 if self.line is None else self.line.baud

    def read(self) -> bytes:
        """What a client has sent; empty when there is nothing."""
        return b"" if self.line is None else self.line.read()

    def write(self, data: bytes) -> None:
        """Send to whoever listens."""
        if self.line is not None:
            self.line.write(data)

    def __enter__(self) -> Self:
        self.line = PtyLink(self.link)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.unplug()
