"""The contract of every Port, tested on the virtual port and on a serial device (a pseudo-terminal)."""

import fcntl
import os
import struct
import termios
import time
import tty
from collections.abc import Callable, Iterator
from typing import Protocol

import pytest

from drivers.clock import Clock, MonotonicClock
from drivers.driver_errors import PortLost
from drivers.port import Port
from drivers.port.serial_port import SerialPort
from drivers.protocol import v1 as wire
from servoloop.recording.bus_tap import BusTaps
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant

PING = wire.packet(1, 1, b"")
PONG = wire.packet(1, 0, b"")


class Line(Protocol):
    """A port with a servo at its far end."""

    port: Port
    clock: Clock

    def ask(self) -> None:
        """Send a ping through the port. When this method returns, the reply is on the way."""
        ...

    def arrive(self, size: int) -> None:
        """Wait until ``size`` bytes can be read."""
        ...

    def unplug(self) -> None:
        """Close the far end."""
        ...


class VirtualLine:
    def __init__(self) -> None:
        self.clock = SimulatedClock(10.0)
        self._port = VirtualPort(VirtualBus.of(BenchPlant((1,))), self.clock)
        self.port: Port = self._port

    def ask(self) -> None:
        self.port.write(PING)

    def arrive(self, size: int) -> None:
        self.clock.sleep_until(self.clock.now() + 0.1)

    def unplug(self) -> None:
        self._port.unplug()


class TerminalLine:
    def __init__(self) -> None:
        self.clock = MonotonicClock()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port: Port = SerialPort(os.ttyname(self._slave), clock=self.clock)

    def ask(self) -> None:
        self.port.write(PING)
        assert os.read(self._master, 100) == PING
        os.write(self._master, PONG)

    def arrive(self, size: int) -> None:
        deadline_s = time.monotonic() + 20.0
        while _waiting(self._slave) < size:
            assert time.monotonic() < deadline_s
            time.sleep(0.001)

    def unplug(self) -> None:
        os.close(self._master)
        self._master = -1

    def end(self) -> None:
        self.port.close()
        os.close(self._slave)
        if self._master >= 0:
            os.close(self._master)


def _waiting(descriptor: int) -> int:
    count: int = struct.unpack("i", fcntl.ioctl(descriptor, termios.FIONREAD, b"\0\0\0\0"))[0]
    return count


class TappedLine(VirtualLine):
    def __init__(self) -> None:
        super().__init__()
        self.port = BusTaps().tap(self.port, self.clock)


@pytest.fixture(params=["virtual", "tapped", "serial"])
def line(request: pytest.FixtureRequest) -> Iterator[Line]:
    if request.param != "serial":
        yield TappedLine() if request.param == "tapped" else VirtualLine()
        return
    terminal = TerminalLine()
    yield terminal
    terminal.end()


def uses(port: Port) -> list[Callable[[], object]]:
    return [lambda: port.write(PING), lambda: port.read(1, 0.0), port.discard_input]


def test_a_port_has_a_name_and_a_baud_rate(line: Line) -> None:
    assert line.port.name
    assert line.port.baud == 1_000_000


def test_a_read_returns_as_soon_as_all_bytes_are_received(line: Line) -> None:
    line.ask()
    begin_s = line.clock.now()
    assert line.port.read(6, begin_s + 30.0) == PONG
    assert line.clock.now() < begin_s + 30.0


def test_a_read_returns_at_most_the_requested_bytes(line: Line) -> None:
    line.ask()
    assert line.port.read(2, line.clock.now() + 20.0) == PONG[:2]
    assert line.port.read(4, line.clock.now() + 20.0) == PONG[2:]


def test_a_read_returns_the_bytes_received_by_its_deadline(line: Line) -> None:
    line.ask()
    line.arrive(6)
    deadline_s = line.clock.now() + 0.03
    assert line.port.read(7, deadline_s) == PONG
    assert line.clock.now() >= deadline_s


def test_a_read_of_silence_returns_nothing_at_its_deadline(line: Line) -> None:
    deadline_s = line.clock.now() + 0.03
    assert line.port.read(1, deadline_s) == b""
    assert line.clock.now() >= deadline_s


def test_a_read_after_its_deadline_returns_received_bytes(line: Line) -> None:
    line.ask()
    line.arrive(6)
    past_s = line.clock.now() - 1.0
    assert line.port.read(100, past_s) == PONG
    assert line.port.read(100, past_s) == b""


def test_a_read_of_zero_bytes_does_not_wait(line: Line) -> None:
    line.ask()
    line.arrive(6)
    assert line.port.read(0, line.clock.now() - 1.0) == b""
    assert line.port.read(6, line.clock.now() + 20.0) == PONG


def test_replies_come_in_order(line: Line) -> None:
    for _ in range(3):
        line.ask()
    assert line.port.read(18, line.clock.now() + 20.0) == PONG * 3


def test_discarding_drops_only_received_bytes(line: Line) -> None:
    line.ask()
    line.arrive(6)
    line.port.discard_input()
    assert line.port.read(1, line.clock.now()) == b""
    line.ask()
    assert line.port.read(6, line.clock.now() + 20.0) == PONG


def test_discarding_without_input_is_not_an_error(line: Line) -> None:
    line.port.discard_input()
    line.port.discard_input()


def test_closing_twice_is_not_an_error_and_other_calls_raise(line: Line) -> None:
    line.port.close()
    line.port.close()
    for use in uses(line.port):
        with pytest.raises(PortLost):
            use()


def test_every_method_raises_port_lost_with_the_name(line: Line) -> None:
    line.unplug()
    for use in uses(line.port) * 2:
        with pytest.raises(PortLost) as caught:
            use()
        assert line.port.name in str(caught.value)
    line.port.close()


def test_a_port_lost_during_a_reply_raises_within_two_reads(line: Line) -> None:
    line.ask()
    line.unplug()
    with pytest.raises(PortLost):
        for _ in range(2):
            line.port.read(6, line.clock.now() + 20.0)
