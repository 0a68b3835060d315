"""The very bytes of our driver's cycle without a driver: what kernel, line and simulator take by themselves.

What a driver adds is its own row less this one. On a machine that is busy with something else this row grows too.
"""

import os
import select
import termios
from collections.abc import Callable, Sequence

import serial

from benchmarks.peers import Client
from drivers.errors import DriverError
from drivers.port import Port
from drivers.port.serial_port import LARGEST_VMIN, SerialPort

Step = bytes | int
"""Bytes to send, or how many to wait for."""

_TRIES = 10
_WAIT_MS = 50


class Recorder(SerialPort):
    """A port that notes what goes through it."""

    def __init__(self, device: str, baud: int) -> None:
        super().__init__(device, baud)
        self.steps: list[Step] = []

    def write(self, data: bytes) -> None:
        super().write(data)
        self.steps.append(data)

    def read(self, size: int, deadline_s: float) -> bytes:
        data = super().read(size, deadline_s)
        self.steps.append(size)
        return data


def bare(driver: Callable[[Port, Sequence[int]], Client], device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """A cycle in which ``driver`` has heard everybody, again and again, by system calls alone."""
    for _ in range(_TRIES):
        port = Recorder(device, baud)
        cycle, close = driver(port, servo_ids)
        try:
            steps = _good_cycle(port, cycle)
        finally:
            close()
        again, end = _replay(serial.Serial(device, baud, timeout=0, exclusive=True), steps)
        # On a machine that stalls even two cycles alike may have the same late answer in them.
        if again() or again():
            return again, end
        end()
    raise DriverError(f"{device}: what the driver did is not answered again")


def _good_cycle(port: Recorder, cycle: Callable[[], bool]) -> list[Step]:
    """What two good cycles in a row did alike: no time-out and no second question is in it."""
    last: list[Step] = []
    for _ in range(_TRIES):
        port.steps.clear()
        if cycle() and port.steps == last:
            return last
        last = list(port.steps)
    raise DriverError(f"{port.name}: not all servos answer: no two good cycles alike in {_TRIES}")


def _replay(line: serial.Serial, steps: list[Step]) -> Client:
    fd, write, read = line.fileno(), os.write, os.read
    sizes = [step for step in steps if isinstance(step, int)]
    # One wake-up for a whole answer, as the driver asks for it.
    _wake_at(fd, sizes[0] if len(sizes) == 1 and sizes[0] <= LARGEST_VMIN else 1)
    waiting = select.poll()
    waiting.register(fd, select.POLLIN)
    poll = waiting.poll

    def cycle() -> bool:
        for step in steps:
            if isinstance(step, bytes):
                write(fd, step)
                continue
            missing = step
            while missing:
                if not poll(_WAIT_MS):
                    line.reset_input_buffer()
                    return False
                missing -= _taken(read, fd, missing)
        return True

    return cycle, line.close


def _taken(read: Callable[[int, int], bytes], fd: int, size: int) -> int:
    """How much of it is there; the kernel may hand it over in pieces of 64 bytes."""
    taken = 0
    try:
        while taken < size:
            piece = read(fd, size - taken)
            if not piece:
                raise DriverError("the simulator is gone")
            taken += len(piece)
    except BlockingIOError:
        pass
    return taken


def _wake_at(fd: int, size: int) -> None:
    settings = termios.tcgetattr(fd)
    settings[6][termios.VMIN] = size
    termios.tcsetattr(fd, termios.TCSANOW, settings)
