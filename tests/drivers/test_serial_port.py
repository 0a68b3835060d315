"""The serial port: which devices it opens, and the messages about devices that it does not open."""

import errno
import fcntl
import grp
import os
import re
import signal
import stat
import struct
import subprocess
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial

from drivers.clock import MonotonicClock
from drivers.driver_errors import PortBusy, PortDenied, PortError, PortLost, PortMissing, PortNotSerial
from drivers.port import owners, serial_port
from drivers.port.owners import port_owners
from drivers.port.serial_port import SerialPort

HOLD = """
import sys
device, how = sys.argv[1:]
if how == "exclusive":
    import serial
    held = serial.Serial(device, 115200, exclusive=True)
elif how == "sdk":
    import scservo_sdk
    held = scservo_sdk.PortHandler(device)
    assert held.openPort()
else:
    held = open(device, "rb", buffering=0)
print("held", flush=True)
sys.stdin.read()
"""


class Terminal:
    """A pseudo-terminal. A program opens ``device``, and ``master`` is the servos' end."""

    def __init__(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.device = os.ttyname(slave)
        os.close(slave)

    def end(self) -> None:
        if self.master >= 0:
            os.close(self.master)
            self.master = -1


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.end()


class _Refusal:
    """Replaces serial.Serial and fails to open."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def __call__(self, *_: Any, **__: Any) -> serial.Serial:
        raise self.error


def refuse(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    monkeypatch.setattr(serial, "Serial", _Refusal(error))


def with_errno(number: int) -> serial.SerialException:
    return serial.SerialException(number, f"could not open port: {os.strerror(number)}")


# Missing


def test_a_missing_device_is_named_with_the_ports_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = {"ttyACM*": ["/dev/ttyACM3"], "ttyUSB*": ["/dev/ttyUSB0"]}
    monkeypatch.setattr(Path, "glob", lambda self, pattern: [Path(p) for p in found[pattern]])
    missing = tmp_path / "ttyACM0"
    with pytest.raises(PortMissing) as caught:
        SerialPort(str(missing))
    assert str(caught.value) == (
        f"{missing} does not exist: plug in the adapter or choose another port (found: /dev/ttyACM3, /dev/ttyUSB0)"
    )


def test_a_missing_device_on_a_machine_without_ports(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(Path, "glob", lambda self, pattern: [])
    with pytest.raises(PortMissing, match=r"\(found: none\)"):
        SerialPort(str(tmp_path / "ttyACM0"))


def test_a_device_whose_name_is_too_long_is_missing() -> None:
    with pytest.raises(PortMissing, match="does not exist"):
        SerialPort(f"/dev/{'n' * 256}")


def test_a_dangling_link_is_a_missing_device(tmp_path: Path) -> None:
    link = tmp_path / "bus"
    link.symlink_to(tmp_path / "gone")
    with pytest.raises(PortMissing, match="does not exist"):
        SerialPort(str(link))


@pytest.mark.parametrize("number", [2, 6, 19], ids=["ENOENT", "ENXIO", "ENODEV"])
def test_a_device_that_disappears_while_it_is_opened_is_missing(
    monkeypatch: pytest.MonkeyPatch, terminal: Terminal, number: int
) -> None:
    refuse(monkeypatch, with_errno(number))
    with pytest.raises(PortMissing, match=f"{terminal.device} does not exist"):
        SerialPort(terminal.device)


# In use


@pytest.mark.parametrize("how", ["exclusive", "sdk", "plain"])
def test_a_port_in_use_names_its_owner(terminal: Terminal, how: str, tmp_path: Path) -> None:
    """Only one of the two programs locks the device. Two programs on one bus disturb each other even if one of them
    does not lock the device."""
    link = tmp_path / "bus"
    link.symlink_to(terminal.device)
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, terminal.device, how], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert holder.stdin is not None and holder.stdout is not None
    try:
        assert holder.stdout.readline() == "held\n"
        command = f"{Path(sys.executable).name} -c {HOLD}".encode("unicode_escape").decode()
        owner = f"{command[:80]}… (process {holder.pid})"
        for device in (terminal.device, str(link)):
            with pytest.raises(PortBusy) as caught:
                SerialPort(device)
            assert str(caught.value) == f"{device} is in use by {owner}: end that program first"
        assert list(port_owners(link)) == [owner]
    finally:
        holder.communicate()
    SerialPort(terminal.device).close()


def test_an_owner_that_cannot_be_identified(monkeypatch: pytest.MonkeyPatch, terminal: Terminal) -> None:
    monkeypatch.setattr(serial_port, "port_owners", lambda path: iter(()))
    refuse(monkeypatch, serial.SerialException(11, "Could not exclusively lock port x: Resource unavailable"))
    with pytest.raises(PortBusy, match="in use by a program of another user: end that program first"):
        SerialPort(terminal.device)


def test_a_second_opening_in_this_program_is_refused(terminal: Terminal) -> None:
    first = SerialPort(terminal.device)
    with pytest.raises(PortBusy, match=f"{terminal.device} is already open in this program: close it first"):
        SerialPort(terminal.device)
    first.close()
    SerialPort(terminal.device).close()


def test_the_server_of_a_pseudo_terminal_is_not_an_owner(terminal: Terminal) -> None:
    """An emulator keeps both ends open."""
    serve = """
import os, sys
master, slave = os.openpty()
print(os.ttyname(slave), flush=True)
sys.stdin.read()
"""
    server = subprocess.Popen([sys.executable, "-c", serve], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert server.stdin is not None and server.stdout is not None
    try:
        SerialPort(server.stdout.readline().strip()).close()
    finally:
        server.communicate()


def test_a_descriptor_that_is_closed_during_the_search_hides_no_other_descriptor(tmp_path: Path) -> None:
    (tmp_path / "fd").mkdir()
    (tmp_path / "fd" / "3").write_text("a name without a link, like a descriptor that has just been closed")
    (tmp_path / "fd" / "4").symlink_to("/dev/ttyUSB7")
    (tmp_path / "fd" / "5").write_text("")
    assert list(owners.open_files(tmp_path)) == [("4", "/dev/ttyUSB7")]


def test_the_server_of_a_pseudo_terminal_that_closes_other_files_is_not_an_owner(tmp_path: Path) -> None:
    (tmp_path / "fd").mkdir()
    (tmp_path / "fdinfo").mkdir()
    (tmp_path / "fd" / "3").write_text("")
    (tmp_path / "fd" / "4").symlink_to("/dev/ptmx")
    (tmp_path / "fd" / "5").symlink_to("/dev/ptmx")
    (tmp_path / "fdinfo" / "5").write_text("pos:\t0\ntty-index:\t77\n")
    assert owners._serves(tmp_path, Path("/dev/pts/77"))
    assert not owners._serves(tmp_path, Path("/dev/pts/7"))


# In use by this program

TIOCGEXCL = 0x80045440
NOBODY = 65534


@pytest.fixture
def adapter(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """A pseudo-terminal that is treated as an adapter. A second file descriptor shows the state of the terminal."""
    monkeypatch.setattr(owners, "PSEUDO_TERMINALS", Path("/nowhere"))
    return terminal


def shut(terminal: Terminal) -> bool:
    """Return whether the kernel refuses to open the device for other programs. The kernel refuses nothing to root, and
    tests may run as root."""
    looking = os.open(terminal.device, os.O_RDWR | os.O_NOCTTY)
    try:
        return struct.unpack("i", fcntl.ioctl(looking, TIOCGEXCL, bytes(4))) == (1,)
    finally:
        os.close(looking)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can inspect a device that is closed to all other users")
def test_an_open_port_excludes_programs_that_do_not_lock(adapter: Terminal) -> None:
    port = SerialPort(adapter.device)
    assert shut(adapter)
    port.set_baud(115_200)
    assert shut(adapter)
    port.close()
    assert not shut(adapter)
    port.close()


def opened_by_nobody(device: str) -> str:
    """Run a program as an ordinary user, open the device as the SDKs do, and return the output of the program."""
    program = (
        "import os, sys\n"
        "try: os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)\n"
        "except OSError as error: print(error.strerror)\n"
        "else: print('open')"
    )
    # Use the system's Python, because an ordinary user may not have access to the environment's Python.
    command = ["/usr/bin/python3", "-c", program, device]
    try:
        ran = subprocess.run(command, capture_output=True, text=True, user=NOBODY, group=NOBODY, cwd="/")
    except OSError:
        pytest.skip("no Python that another user may run")
    return ran.stdout.strip()


@pytest.mark.skipif(os.getuid() != 0, reason="only root may run a program as another user")
def test_an_open_port_is_busy_for_another_user(adapter: Terminal) -> None:
    os.chmod(adapter.device, 0o666)
    port = SerialPort(adapter.device)
    assert opened_by_nobody(adapter.device) == os.strerror(errno.EBUSY)
    port.close()
    assert opened_by_nobody(adapter.device) == "open"


def test_a_port_that_cannot_be_used_is_left_open_to_others(adapter: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_fit(*_: object) -> None:
        raise PortError("does not fit")

    monkeypatch.setattr(serial_port, "_check_rate", no_fit)
    with pytest.raises(PortError, match="does not fit"):
        SerialPort(adapter.device)
    assert not shut(adapter)


def test_a_killed_program_does_not_block_the_emulators_port(terminal: Terminal) -> None:
    """The kernel releases the exclusive lock at the last close, but the far end of a pseudo-terminal stays open."""
    program = (
        "import os, signal, sys; from drivers.port.serial_port import SerialPort\n"
        "port = SerialPort(sys.argv[1]); os.kill(os.getpid(), signal.SIGKILL)"
    )
    killed = subprocess.run([sys.executable, "-c", program, terminal.device], cwd=Path(__file__).parents[2])
    assert killed.returncode == -signal.SIGKILL
    assert not shut(terminal)
    SerialPort(terminal.device).close()


# Denied or unsuitable


def test_a_denied_port_names_the_group_and_the_command(monkeypatch: pytest.MonkeyPatch, terminal: Terminal) -> None:
    refuse(monkeypatch, with_errno(13))
    monkeypatch.setattr(grp, "getgrgid", lambda number: type("Group", (), {"gr_name": "dialout"}))
    with pytest.raises(PortDenied) as caught:
        SerialPort(terminal.device)
    assert str(caught.value) == (
        f"no permission to open {terminal.device}: it belongs to the group 'dialout'. "
        "Run 'sudo usermod -aG dialout $USER', then log out and in again"
    )


def test_a_device_in_a_folder_without_permission_is_denied(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def refuse_access(path: Path) -> os.stat_result:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "stat", refuse_access)
    device = tmp_path / "ttyACM0"
    with pytest.raises(PortDenied) as caught:
        SerialPort(str(device))
    assert str(caught.value) == (
        f"no permission to access the folder of {device}: change its permissions, or choose another port"
    )


def test_the_advice_is_never_to_join_the_group_root(monkeypatch: pytest.MonkeyPatch, terminal: Terminal) -> None:
    refuse(monkeypatch, with_errno(13))
    monkeypatch.setattr(grp, "getgrgid", lambda number: type("Group", (), {"gr_name": "root"}))
    with pytest.raises(PortDenied) as caught:
        SerialPort(terminal.device)
    assert str(caught.value) == (
        f"no permission to open {terminal.device}: only root can open it. To give it to the group 'dialout', add the "
        """line 'KERNEL=="ttyUSB*|ttyACM*", GROUP="dialout", MODE="0660"' to /etc/udev/rules.d/99-servos.rules """
        "and plug the adapter in again. Run 'sudo usermod -aG dialout $USER', then log out and in again"
    )


def test_a_group_without_a_name_is_named_by_its_number(monkeypatch: pytest.MonkeyPatch, terminal: Terminal) -> None:
    def nameless(number: int) -> object:
        raise KeyError(number)

    refuse(monkeypatch, with_errno(13))
    monkeypatch.setattr(grp, "getgrgid", nameless)
    with pytest.raises(PortDenied, match=f"the group '{os.stat(terminal.device).st_gid}'"):
        SerialPort(terminal.device)


def test_the_group_is_that_of_the_linked_device(
    monkeypatch: pytest.MonkeyPatch, terminal: Terminal, tmp_path: Path
) -> None:
    link = tmp_path / "arm"
    link.symlink_to(terminal.device)
    asked: list[int] = []
    refuse(monkeypatch, with_errno(13))
    monkeypatch.setattr(grp, "getgrgid", lambda n: asked.append(n) or type("G", (), {"gr_name": "tty"}))
    with pytest.raises(PortDenied, match="'tty'"):
        SerialPort(str(link))
    assert asked == [os.stat(terminal.device).st_gid]


@pytest.mark.parametrize(
    "error", [ValueError("Failed to set custom baud rate (12345678): [Errno 22]"), ValueError("Not a valid baudrate")]
)
def test_an_unsupported_baud_rate_is_named(
    monkeypatch: pytest.MonkeyPatch, terminal: Terminal, error: Exception
) -> None:
    refuse(monkeypatch, error)
    with pytest.raises(PortError, match=f"{terminal.device} does not support 12345678 baud") as caught:
        SerialPort(terminal.device, 12_345_678)
    assert str(error) in str(caught.value)


@pytest.mark.parametrize("baud", [99_999_999_999, 10**30])
def test_an_impossible_baud_rate_is_refused(terminal: Terminal, baud: int) -> None:
    with pytest.raises(PortError, match=f"does not support {baud} baud"):
        SerialPort(terminal.device, baud)
    port = SerialPort(terminal.device, 115_200)
    with pytest.raises(PortError, match=f"does not support {baud} baud"):
        port.set_baud(baud)
    assert port.baud == 115_200
    port.write(b"x")


def test_an_unsupported_baud_rate_leaves_the_device_free(monkeypatch: pytest.MonkeyPatch, terminal: Terminal) -> None:
    def refused(self: serial.Serial, baud: int) -> None:
        raise ValueError("Failed to set custom baud rate")

    with monkeypatch.context() as patch:
        patch.setattr(serial.Serial, "_set_special_baudrate", refused)
        with pytest.raises(PortError, match="does not support 1234567 baud"):
            SerialPort(terminal.device, 1_234_567)
    SerialPort(terminal.device).close()


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_path_that_is_not_a_device_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "thing"
    path.touch() if kind == "file" else path.mkdir()
    with pytest.raises(PortError, match=re.escape(str(path))):
        SerialPort(str(path))


def test_any_other_error_keeps_its_reason(monkeypatch: pytest.MonkeyPatch, terminal: Terminal) -> None:
    refuse(monkeypatch, with_errno(5))
    with pytest.raises(PortError, match=f"cannot open {terminal.device}: .*Input/output error"):
        SerialPort(terminal.device)


# Open


def test_a_link_can_be_opened_and_keeps_its_name(terminal: Terminal, tmp_path: Path) -> None:
    link = tmp_path / "arm"
    link.symlink_to(terminal.device)
    port = SerialPort(str(link))
    assert port.name == str(link)
    port.write(b"ping")
    assert os.read(terminal.master, 100) == b"ping"
    port.close()


@pytest.mark.parametrize("baud", [1_000_000, 115_200, 38_400])
def test_the_terminal_is_raw_and_has_the_baud_rate(terminal: Terminal, baud: int) -> None:
    port = SerialPort(terminal.device, baud)
    assert port.baud == baud
    every_byte = bytes(range(256))
    port.write(every_byte)
    assert os.read(terminal.master, 1000) == every_byte
    os.write(terminal.master, every_byte)
    assert port.read(256, MonotonicClock().now() + 20.0) == every_byte
    port.close()


def test_more_bytes_than_the_kernel_accepts_at_once_are_all_sent(terminal: Terminal) -> None:
    port = SerialPort(terminal.device)
    data = bytes(i % 251 for i in range(50_000))
    received = bytearray()

    def listen() -> None:
        while len(received) < len(data):
            received.extend(os.read(terminal.master, 4096))

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    port.write(data)
    listener.join(20.0)
    assert bytes(received) == data
    port.close()


def test_a_device_that_accepts_no_more_bytes_is_lost_after_a_wait(
    monkeypatch: pytest.MonkeyPatch, terminal: Terminal
) -> None:
    monkeypatch.setattr(serial_port, "STALLED_S", 0.05)
    port = SerialPort(terminal.device)
    with pytest.raises(PortLost, match=r"accepts no more bytes.*check the cable"):
        for _ in range(1_000_000):  # the far end does not read
            port.write(bytes(100))
    port.close()


def test_input_from_before_the_opening_is_discarded(terminal: Terminal) -> None:
    os.write(terminal.master, b"stale")
    port = SerialPort(terminal.device)
    port.discard_input()
    assert port.read(5, 0.0) == b""
    port.close()


def test_a_closed_far_end_is_a_lost_port_with_a_remedy(terminal: Terminal) -> None:
    port = SerialPort(terminal.device)
    terminal.end()
    with pytest.raises(PortLost, match=f"{terminal.device} has disappeared.*check the cable"):
        port.read(1, MonotonicClock().now() + 20.0)
    port.close()


def test_setting_the_baud_rate_of_a_lost_port_raises_port_lost(terminal: Terminal) -> None:
    port = SerialPort(terminal.device)
    terminal.end()
    with pytest.raises(PortLost, match=f"{terminal.device} has disappeared"):
        port.set_baud(115_200)
    port.close()


def test_a_closed_port_can_be_opened_by_others(terminal: Terminal) -> None:
    port = SerialPort(terminal.device)
    descriptor = port._fd
    assert stat.S_ISCHR(os.fstat(descriptor).st_mode)
    port.close()
    with pytest.raises(OSError):
        os.fstat(descriptor)


def test_a_closed_port_never_uses_a_reused_descriptor(terminal: Terminal, tmp_path: Path) -> None:
    port = SerialPort(terminal.device)
    number = port._fd
    port.close()
    other = os.open(tmp_path / "log", os.O_RDWR | os.O_CREAT)
    try:
        os.dup2(other, number)
        with pytest.raises(PortLost):
            port.write(b"bytes for a servo")
        with pytest.raises(PortLost):
            port.read(1, 0.0)
        assert (tmp_path / "log").read_bytes() == b""
    finally:
        os.close(other)
        if other != number:
            os.close(number)


def test_a_long_burst_is_read_whole_and_a_short_one_at_its_deadline(terminal: Terminal) -> None:
    """The kernel waits for a given number of bytes, but fewer bytes must also be returned."""
    port = SerialPort(terminal.device)
    burst = bytes(range(200))
    for at in range(0, 200, 20):
        os.write(terminal.master, burst[at : at + 20])
    assert port.read(200, MonotonicClock().now() + 20.0) == burst
    os.write(terminal.master, burst[:90])
    assert port.read(200, MonotonicClock().now() + 0.05) == burst[:90]
    os.write(terminal.master, b"end")
    assert port.read(3, MonotonicClock().now() + 20.0) == b"end"
    os.write(terminal.master, burst * 2)
    assert port.read(400, MonotonicClock().now() + 20.0) == burst * 2
    port.close()


@pytest.mark.parametrize("size", [40, 98, 200])
def test_a_second_burst_of_the_same_size(terminal: Terminal, size: int) -> None:
    """The kernel setting is not written again, and the kernel may return the burst in several pieces."""
    port, now = SerialPort(terminal.device), MonotonicClock().now
    burst = bytes(range(size))
    for _ in range(3):
        os.write(terminal.master, burst)
        assert port.read(size, now() + 20.0) == burst
    assert port.read(size, now() - 1.0) == b""  # the deadline has passed, and there is no input
    os.write(terminal.master, burst[:35])
    assert port.read(size, now() + 0.02) == burst[:35]
    port.close()


# Waiting


@pytest.mark.parametrize("size", [6, 98, 162, 238])
def test_replies_of_one_size_need_one_kernel_setting(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    """The kernel returns a burst in pieces of 64 bytes, for which no separate waits are needed."""
    port, clock = SerialPort(terminal.device), MonotonicClock()
    settings = []
    real = termios.tcsetattr
    monkeypatch.setattr(termios, "tcsetattr", lambda *what: settings.append(what) or real(*what))
    answer = bytes(range(size))
    for _ in range(5):
        os.write(terminal.master, answer)
        assert port.read(size, clock.now() + 20.0) == answer
    port.close()
    assert len(settings) == 1


@pytest.mark.parametrize("size", [98, 162])
def test_a_port_lost_within_a_reply_raises_port_lost(terminal: Terminal, size: int) -> None:
    port, clock = SerialPort(terminal.device), MonotonicClock()
    os.write(terminal.master, bytes(size))
    assert port.read(size, clock.now() + 20.0) == bytes(size)
    os.write(terminal.master, bytes(size - 20))
    terminal.end()
    with pytest.raises(PortLost):
        port.read(size, clock.now() + 20.0)
    port.close()


@pytest.mark.parametrize(("make", "kind"), [(Path.mkdir, "a folder"), (Path.touch, "a file")])
def test_a_path_that_is_not_a_serial_device_is_named_with_its_kind(
    tmp_path: Path, make: Callable[[Path], None], kind: str
) -> None:
    path = tmp_path / "port"
    make(path)
    with pytest.raises(PortNotSerial, match=f"{path} is not a serial device but {kind}: choose the adapter's port"):
        SerialPort(str(path))


def test_a_device_that_is_not_serial_is_reported() -> None:
    with pytest.raises(PortNotSerial, match="/dev/null is not a serial device but another kind of device"):
        SerialPort("/dev/null")
