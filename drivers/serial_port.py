"""A real serial device (or a pseudo-terminal) as a Port."""

import errno
import grp
import os
import select
import termios
from collections.abc import Iterator
from pathlib import Path

import serial

from drivers.clock import Clock, MonotonicClock
from drivers.errors import PortBusy, PortDenied, PortError, PortLost, PortMissing

_BURST = 32
"""From this many expected bytes on, one wake-up for all is worth telling the kernel."""
_LARGEST_VMIN = 255


class SerialPort:
    """Opens a device exclusively and waits on its file descriptor, never spinning.

    Raises PortMissing, PortBusy (with the owner's name) or PortDenied (with the group to join).
    """

    def __init__(self, device: str, baud: int = 1_000_000, clock: Clock | None = None) -> None:
        self.name = device
        self.baud = baud
        self._clock = clock or MonotonicClock()
        self._serial = _open(device, baud)
        self._fd: int = self._serial.fileno()
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        self._wake_size = 0
        self._settings = termios.tcgetattr(self._fd)

    def write(self, data: bytes) -> None:
        try:
            sent = os.write(self._fd, data)
            while sent < len(data):  # the kernel's buffer was full: rare, a request is short
                select.select([], [self._fd], [], 1.0)
                sent += os.write(self._fd, data[sent:])
        except (OSError, ValueError) as error:
            raise self._lost(error) from error

    def read(self, size: int, deadline_s: float) -> bytes:
        received = b""
        while missing := size - len(received):
            wake_size = 1 if missing < _BURST else min(missing, _LARGEST_VMIN)
            if wake_size != self._wake_size:
                self._wake_at(wake_size)
            ready = self._wait(deadline_s - self._clock.now())
            received += self._take(missing)
            if not ready:
                break
        return received

    def discard_input(self) -> None:
        try:
            termios.tcflush(self._fd, termios.TCIFLUSH)
        except (termios.error, OSError, ValueError) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        self._serial.close()
        self._fd = -1

    def _wake_at(self, size: int) -> None:
        """Ask the kernel to wake us when a whole burst is there, not at each of its pieces.

        On Linux a poll of a raw terminal waits for VMIN bytes; what knows no VMIN only wakes us more
        often. Short replies are not worth the call.
        """
        self._settings[6][termios.VMIN] = size
        try:
            termios.tcsetattr(self._fd, termios.TCSANOW, self._settings)
        except (termios.error, OSError, ValueError) as error:
            raise self._lost(error) from error
        self._wake_size = size

    def _wait(self, wait_s: float) -> bool:
        """Until enough can be read; poll counts in milliseconds, select does the rest."""
        try:
            if self._poll.poll(int(wait_s * 1000.0) if wait_s > 0.0 else 0):
                return True
            rest_s = wait_s % 0.001 if wait_s > 0.0 else 0.0
            return rest_s > 0.0 and bool(select.select([self._fd], [], [], rest_s)[0])
        except (OSError, ValueError) as error:
            raise self._lost(error) from error

    def _take(self, size: int) -> bytes:
        """What is there, at most ``size``; the kernel may hand it over in pieces of 64 bytes."""
        received = b""
        try:
            while len(received) < size:
                data = os.read(self._fd, size - len(received))
                if not data:  # readable, yet nothing to read: the other end hung up
                    raise self._lost(None)
                received += data
        except BlockingIOError:
            pass
        except (OSError, ValueError) as error:
            raise self._lost(error) from error
        return received

    def _lost(self, error: Exception | None) -> PortLost:
        reason = f" ({error})" if error else ""
        return PortLost(f"{self.name} is gone{reason}: check the cable and the servos' power, then start again")


def _open(device: str, baud: int) -> serial.Serial:
    path = Path(device)
    if not path.exists():
        raise PortMissing(_missing_text(device))
    # A program that does not lock the device (the SDKs do not) is seen only in the process table.
    owners = list(port_owners(path))
    if owners:
        raise PortBusy(f"{device} is in use by {', '.join(owners)}: end that program first")
    try:
        return serial.Serial(device, baud, timeout=0, write_timeout=None, exclusive=True)
    except serial.SerialException as error:
        raise _open_error(path, error) from error
    except (ValueError, OSError, termios.error) as error:
        raise PortError(f"{device} does not take {baud} baud or is no serial port: {error}") from error


def _open_error(path: Path, error: serial.SerialException) -> PortError:
    if error.errno == errno.EACCES:
        return PortDenied(_denied_text(path))
    if error.errno in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        owners = ", ".join(port_owners(path)) or "a program of another user"
        return PortBusy(f"{path} is in use by {owners}: end that program first")
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return PortMissing(_missing_text(str(path)))
    return PortError(f"cannot open {path}: {error}")


def _missing_text(device: str) -> str:
    found = sorted(str(p) for pattern in ("ttyACM*", "ttyUSB*") for p in Path("/dev").glob(pattern))
    return f"there is no {device}: plug in the adapter or name another port (there is {', '.join(found) or 'none'})"


def _denied_text(path: Path) -> str:
    group_id = path.stat().st_gid
    try:
        group = grp.getgrgid(group_id).gr_name
    except KeyError:
        group = str(group_id)
    return (
        f"no permission to open {path}: it belongs to the group '{group}'. Run "
        f"'sudo usermod -aG {group} $USER', log out and in again"
    )


def port_owners(path: Path) -> Iterator[str]:
    """Names of the other processes that hold the device open, as far as we may look."""
    device = path.resolve()
    for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda p: int(p.name)):
        if int(process.name) != os.getpid() and _holds(process, device) and not _serves(process, device):
            yield f"{_command(process)} (process {process.name})"


def _holds(process: Path, device: Path) -> bool:
    try:
        return any(Path(os.readlink(fd)) == device for fd in (process / "fd").iterdir())
    except OSError:  # ended meanwhile, or another user's
        return False


def _serves(process: Path, device: Path) -> bool:
    """Whether the process is the far end of this pseudo-terminal: an emulator keeps both ends open."""
    if device.parent != Path("/dev/pts"):
        return False
    try:
        infos = [(process / "fdinfo" / fd.name).read_text() for fd in _masters(process)]
    except OSError:
        return False
    return any(line.split() == ["tty-index:", device.name] for info in infos for line in info.splitlines())


def _masters(process: Path) -> list[Path]:
    return [fd for fd in (process / "fd").iterdir() if os.readlink(fd).endswith("/ptmx")]


def _command(process: Path) -> str:
    try:
        return (process / "comm").read_text().strip()
    except OSError:
        return "a program"
