"""Send the bytes of our driver's cycle without the driver, to time the kernel, the serial line and the simulator.

The cost of a driver is the time in its own row minus the time in this row. Other load on the machine also increases the
time in this row.
"""

import os
import select
import termios
from collections.abc import Callable, Sequence

import serial

from benchmarks.clients.peers import Client
from drivers.driver_errors import DriverError
from drivers.port import Port
from drivers.port.serial_port import LARGEST_VMIN, SerialPort

Step = bytes | int
"""Bytes to send, or the number of bytes to wait for."""

_TRIES = 10
_WAIT_MS = 50


class RecordingSerialPort(SerialPort):
    """A port that records all writes and reads."""

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
    """Use only system calls to repeat a complete cycle of ``driver``, in which all servos have replied."""
    for _ in range(_TRIES):
        port = RecordingSerialPort(device, baud)
        cycle, close = driver(port, servo_ids)
        try:
            steps = _good_cycle(port, cycle)
        finally:
            close()
        again, end = _replay(serial.Serial(device, baud, timeout=0, exclusive=True), steps)
        # If the machine stalls, even two identical cycles may contain the same late reply.
        if again() or again():
            return again, end
        end()
    raise DriverError(f"{device}: the servos did not respond to the repeated cycle")


def _good_cycle(port: RecordingSerialPort, cycle: Callable[[], bool]) -> list[Step]:
    """Return the steps of the first two consecutive cycles that are identical and complete.

    Such cycles contain neither a timeout nor a repeated request.
    """
    last: list[Step] = []
    for _ in range(_TRIES):
        port.steps.clear()
        if cycle() and port.steps == last:
            return last
        last = list(port.steps)
    raise DriverError(
        f"{port.name}: not all servos respond reliably: in {_TRIES} cycles, no two in a row were complete and identical"
    )


def _replay(line: serial.Serial, steps: list[Step]) -> Client:
    fd, write, read = line.fileno(), os.write, os.read
    sizes = [step for step in steps if isinstance(step, int)]
    # Wake up once per complete reply, as the driver does.
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
    """Return the number of bytes read. The kernel may return a reply in chunks of 64 bytes."""
    taken = 0
    try:
        while taken < size:
            piece = read(fd, size - taken)
            if not piece:
                raise DriverError("the simulator has exited")
            taken += len(piece)
    except BlockingIOError:
        pass
    return taken


def _wake_at(fd: int, size: int) -> None:
    settings = termios.tcgetattr(fd)
    settings[6][termios.VMIN] = size
    termios.tcsetattr(fd, termios.TCSANOW, settings)
