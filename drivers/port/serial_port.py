"""Port for a serial device or a pseudo-terminal."""

import contextlib
import errno
import fcntl
import grp
import logging
import os
import select
import stat
import termios
from pathlib import Path

import serial

from drivers.clock import Clock, MonotonicClock
from drivers.driver_errors import PortBusy, PortDenied, PortError, PortLost, PortMissing, PortNotSerial
from drivers.paths import resolved
from drivers.port.latency import latency_advice
from drivers.port.owners import held_by_us, is_pseudo_terminal, port_owners

LOG = logging.getLogger("servoloop.drivers")

_BURST = 32
"""Minimum number of expected bytes for which the kernel is asked for a single wake-up."""
LARGEST_VMIN = 255
STALLED_S = 1.0
"""Maximum time without the kernel accepting a byte, in seconds. At 115200 baud, transmitting the 4 KB in the kernel's
buffer takes half this time."""
TOLERATED_RATE = 0.02
"""Maximum relative error of the baud rate. A receiver resynchronizes once every ten bits."""
_UDEV_RULE = 'KERNEL=="ttyUSB*|ttyACM*", GROUP="dialout", MODE="0660"'
_TCGETS2, _TERMIOS2_SIZE, _OSPEED_AT = 0x802C542A, 44, 40
"""Kernel call that returns the baud rate as a number (asm-generic/termbits.h). The C library defines constants for only
some rates.
"""


class SerialPort:
    """Serial device that is opened for exclusive use.

    Args:
        device: Path of the device, such as ``/dev/ttyACM0``.
        baud: Baud rate, in bits per second.
        clock: Clock for the deadlines; by default the monotonic clock of the machine.

    Raises:
        PortMissing: The device does not exist.
        PortNotSerial: The path is not a serial device.
        PortBusy: Another program uses the device. The message names the program.
        PortDenied: The user has no permission to open the device. The message names the group to join.
        PortError: The adapter does not support the rate.
    """

    def __init__(self, device: str, baud: int = 1_000_000, clock: Clock | None = None) -> None:
        self.name = device
        self.baud = baud
        self._clock = clock or MonotonicClock()
        self._serial = _open(device, baud)
        self._fd: int = self._serial.fileno()
        try:
            _exclude_others(Path(device), self._fd)
            _check_rate(device, self._fd, baud)
        except PortError:
            self.close()
            raise
        if advice := latency_advice(device):
            LOG.warning("%s", advice)
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        self._settings, self._wake_size = termios.tcgetattr(self._fd), 0

    def write(self, data: bytes) -> None:
        sent = 0
        try:
            sent = os.write(self._fd, data)
            if sent == len(data):
                return
        except BlockingIOError:
            pass
        except (OSError, ValueError) as error:
            raise self._lost(error) from error
        self._wait_for_room()  # rare, because requests are smaller than the kernel's buffer
        self.write(data[sent:])

    def _wait_for_room(self) -> None:
        try:
            room = select.select([], [self._fd], [], STALLED_S)[1]
        except (OSError, ValueError) as error:
            raise self._lost(error) from error
        if not room:
            raise PortLost(f"{self.name} accepts no more bytes: check the cable and the adapter, then start again")

    def read(self, size: int, deadline_s: float) -> bytes:
        # This fast path is short because the processor caches are cold at the start of every cycle.
        received = b""
        try:
            wait_s = deadline_s - self._clock.now()
            if size == self._wake_size and wait_s > 0.0 and self._poll.poll(int(wait_s * 1000.0)):
                received = piece = os.read(self._fd, size)
                while piece and len(received) < size:  # the kernel may return fragments of 64 bytes
                    piece = os.read(self._fd, size - len(received))
                    received += piece
                if len(received) == size:
                    return received
        except BlockingIOError:
            pass
        except (OSError, ValueError) as error:
            raise self._lost(error) from error
        return self._read_on(received, size, deadline_s)

    def _read_on(self, received: bytes, size: int, deadline_s: float) -> bytes:
        """Read until ``size`` bytes are received or the deadline has passed."""
        ready = True
        while ready and (missing := size - len(received)):
            wake_size = 1 if missing < _BURST else min(missing, LARGEST_VMIN)
            if wake_size != self._wake_size:
                self._wake_at(wake_size)
            wait_s = deadline_s - self._clock.now()
            try:
                # poll waits for whole milliseconds, and select waits for the rest.
                ready = bool(self._poll.poll(int(wait_s * 1000.0) if wait_s > 0.0 else 0)) or self._wait_rest(wait_s)
                while len(received) < size:
                    data = os.read(self._fd, size - len(received))
                    if not data:  # the other end has closed the line
                        raise self._lost(None)
                    received += data
            except BlockingIOError:
                pass
            except (OSError, ValueError) as error:
                raise self._lost(error) from error
        return received

    def _wait_rest(self, wait_s: float) -> bool:
        rest_s = wait_s % 0.001 if wait_s > 0.0 else 0.0
        return rest_s > 0.0 and bool(select.select([self._fd], [], [], rest_s)[0])

    def discard_input(self) -> None:
        try:
            termios.tcflush(self._fd, termios.TCIFLUSH)
        except (termios.error, OSError, ValueError) as error:
            raise self._lost(error) from error

    def set_baud(self, baud: int) -> None:
        former = self._serial.baudrate
        try:
            try:
                self._serial.baudrate = baud
                _check_rate(self.name, self._fd, baud)
            except (PortError, ValueError, OverflowError, OSError, termios.error) as error:
                self._serial.baudrate = former  # also raises an error if the device has disappeared
                raise _baud_error(self.name, baud, error) from error
            finally:
                self._settings, self._wake_size = termios.tcgetattr(self._fd), 0
        except (termios.error, OSError, ValueError) as error:
            raise self._lost(error) from error
        self.baud = baud

    def close(self) -> None:
        # Without this, a child process that still has the device open would keep it locked for all other programs.
        with contextlib.suppress(OSError, ValueError):  # the device has disappeared or is closed already
            fcntl.ioctl(self._fd, termios.TIOCNXCL)
        self._serial.close()
        self._fd = -1

    def _wake_at(self, size: int) -> None:
        """Ask the kernel for one wake-up per burst of replies instead of one per fragment.

        On Linux, polling a raw terminal waits for VMIN bytes. A device without VMIN only causes more wake-ups.
        """
        self._settings[6][termios.VMIN] = size
        try:
            termios.tcsetattr(self._fd, termios.TCSANOW, self._settings)
        except (termios.error, OSError, ValueError) as error:
            raise self._lost(error) from error
        self._wake_size = size

    def _lost(self, error: Exception | None) -> PortLost:
        reason = f" ({error})" if error else ""
        return PortLost(f"{self.name} has disappeared{reason}: check the cable and the servos' power, then start again")


def require_port(device: str, baud: int) -> None:
    """Raise PortError if a device cannot be opened. Call this function before the user is asked to hold the arm."""
    _open(device, baud).close()


def _open(device: str, baud: int) -> serial.Serial:
    path, found = Path(device), _look_up(device)
    if not _may_be_serial(found):
        raise PortNotSerial(not_serial_text(device))
    # Only the process table shows programs that do not lock the device, such as those that use the SDKs.
    owners = list(port_owners(path))
    if owners:
        raise PortBusy(f"{device} is in use by {', '.join(owners)}: end that program first")
    try:
        return serial.Serial(device, baud, timeout=0, write_timeout=None, exclusive=True)
    except serial.SerialException as error:
        raise _open_error(path, found.st_gid, error) from error
    except (ValueError, OverflowError, OSError, termios.error) as error:
        raise _baud_error(device, baud, error) from error


def _look_up(device: str) -> os.stat_result:
    try:
        return Path(device).stat()
    except PermissionError as error:
        raise PortDenied(
            f"no permission to access the folder of {device}: change its permissions, or choose another port"
        ) from error
    except (OSError, ValueError) as error:
        raise PortMissing(_missing_text(device)) from error


def _exclude_others(path: Path, fd: int) -> None:
    """Make the kernel reject all other programs except those run by root, because the SDKs ignore the lock.

    A pseudo-terminal is not protected in this way. The kernel ends the protection when the device is closed for the
    last time, but an emulator never closes its end. If this program were killed, no program could open the
    pseudo-terminal again.
    """
    if not is_pseudo_terminal(path):
        with contextlib.suppress(OSError):  # if the device has disappeared, its next use raises PortLost
            fcntl.ioctl(fd, termios.TIOCEXCL)


def _baud_error(device: str, baud: int, error: Exception) -> PortError:
    text = f"{device} does not support {baud} baud or is not a serial port: {error}"
    return error if isinstance(error, PortError) else PortError(text)


def _check_rate(device: str, fd: int, baud: int) -> None:
    """Raise PortError if the adapter has silently chosen a different baud rate."""
    try:
        answer = fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2_SIZE))
    except OSError:  # not a terminal that supports this call
        return
    actual = int.from_bytes(answer[_OSPEED_AT : _OSPEED_AT + 4], "little")
    if actual and abs(actual - baud) > TOLERATED_RATE * baud:
        raise PortError(
            f"{device} runs at {actual} baud instead of {baud}, which its adapter does not support: "
            "set the servos and the robot file to a rate that the adapter supports"
        )


def _open_error(path: Path, group_id: int, error: serial.SerialException) -> PortError:
    if error.errno == errno.EACCES:
        return PortDenied(_denied_text(path, group_id))
    if error.errno in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        owners = ", ".join(port_owners(path))
        if not owners and held_by_us(path):
            return PortBusy(f"{path} is already open in this program: close it first")
        owners = owners or "a program of another user"
        return PortBusy(f"{path} is in use by {owners}: end that program first")
    if error.errno in (errno.ENOTTY, errno.EINVAL) or isinstance(error.__context__, termios.error):
        return PortNotSerial(not_serial_text(str(path)))
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return PortMissing(_missing_text(str(path)))
    return PortError(f"cannot open {path}: {error}")


def _may_be_serial(found: os.stat_result) -> bool:
    """Return whether a path may be a terminal. The path is not opened."""
    if not stat.S_ISCHR(found.st_mode):
        return False
    number = found.st_rdev
    subsystem = Path(f"/sys/dev/char/{os.major(number)}:{os.minor(number)}/subsystem")  # missing for pseudo-terminals
    return not subsystem.exists() or resolved(subsystem).name == "tty"


def _missing_text(device: str) -> str:
    return f"{device} does not exist: plug in the adapter or choose another port (found: {_ports_found()})"


def not_serial_text(device: str) -> str:
    what = "a folder" if Path(device).is_dir() else "a file" if Path(device).is_file() else "another kind of device"
    return f"{device} is not a serial device but {what}: choose the adapter's port (found: {_ports_found()})"


def _ports_found() -> str:
    found = sorted(str(p) for pattern in ("ttyACM*", "ttyUSB*") for p in Path("/dev").glob(pattern))
    return ", ".join(found) or "none"


def _denied_text(path: Path, group_id: int) -> str:
    try:
        group = grp.getgrgid(group_id).gr_name
    except KeyError:
        group = str(group_id)
    owned = f"it belongs to the group '{group}'. "
    if group == "root":  # this group grants far more than access to ports
        group = "dialout"
        owned = (
            f"only root can open it. To give it to the group '{group}', add the line '{_UDEV_RULE}' to "
            "/etc/udev/rules.d/99-servos.rules and plug the adapter in again. "
        )
    return f"no permission to open {path}: {owned}Run 'sudo usermod -aG {group} $USER', then log out and in again"
