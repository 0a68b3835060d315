"""Simulated servo bus that replies as fast as Python can, so that the client under test is the bottleneck.

The simulator runs in a separate process: ``python -m benchmarks.simulator LINK --ids 1-7 [--paced 1000000]``. The
simulator includes neither firmware nor physics; ``servoloop emulate`` includes both.
"""

import argparse
import os
import time
import tty
from pathlib import Path

from benchmarks.dynamixel_servos import DynamixelServos
from benchmarks.shared.arguments import free_path, positive, silence
from drivers.driver_errors import DriverError
from drivers.protocol import v1 as wire
from servoloop.bench.bus import parse_ids

PING, READ, WRITE = 1, 2, 3
TABLE = bytearray(128)
TABLE[3:5] = (777).to_bytes(2, "little")
TABLE[21:23], TABLE[26], TABLE[27], TABLE[85] = bytes((32, 32)), 1, 1, 254  # factory gains
TABLE[16:18] = (1000).to_bytes(2, "little")  # full torque
TABLE[48:50] = (999).to_bytes(2, "little")  # torque limit that our driver sets
TABLE[8], TABLE[18] = 1, 12  # every write is acknowledged, speeds are in counts/s
TABLE[56:64] = bytes((0, 8, 100, 128, 20, 4, 120, 33))  # position 2048, -100 counts/s, -2 %, 12.0 V, 33 C
GRANULE_S = 0.0003
"""Duration of the final part of a wait, in seconds. This part is a busy loop, because a sleep is less accurate."""


class Servos:
    """All servos on one line. Replies are cached after their first use."""

    def __init__(self, servo_ids: list[int]) -> None:
        self.ids = servo_ids
        self.silent: set[int] = set()
        self._kept: dict[bytes, bytes] = {}

    @staticmethod
    def size(data: bytes) -> int:
        """Return the size of the packet at the start of ``data``, or 0 if its header is incomplete."""
        return data[3] + 4 if len(data) > 5 else 0

    def answer(self, packet: bytes) -> bytes:
        """Return all replies to one packet."""
        servo_id, code = packet[2], packet[4]
        if code == wire.SYNC_WRITE:
            return b""
        kept = self._kept.get(packet)
        if kept is None:
            asked = packet[7:-1] if code == wire.SYNC_READ else [servo_id]
            kept = b"".join(self._reply(i, code, packet) for i in asked if i in self.ids and i not in self.silent)
            self._kept[packet] = kept
        return kept

    def silence(self, silent: set[int]) -> None:
        """From now on, make only these servos silent."""
        self.silent = silent
        self._kept.clear()

    def _reply(self, servo_id: int, code: int, packet: bytes) -> bytes:
        content = b""
        if code in (READ, wire.SYNC_READ):
            address, size = packet[5], packet[6]
            content = bytes(self._table(servo_id)[address : address + size])
        return wire.packet(servo_id, 0, content)

    def _table(self, servo_id: int) -> bytearray:
        return TABLE


class SimulatedBus:
    """Servo side of a pseudo-terminal.

    Both ends are open in this process, as in most simulators.
    """

    def __init__(self, link: Path, servos: Servos | DynamixelServos, baud: int) -> None:
        """Open the line. If ``baud`` is 0, transmission time is not simulated."""
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(self._slave))
        self._servos = servos
        self._byte_s = 10.0 / baud if baud else 0.0
        self._free_s = 0.0
        self._rest = b""

    def serve_once(self) -> None:
        """Wait for bytes and reply to all complete packets. The kernel may return a packet in chunks."""
        data = self._rest + os.read(self.master, 4096)
        now_s = time.perf_counter()
        while 0 < (size := self._servos.size(data)) <= len(data):
            packet, data = data[:size], data[size:]
            replies = self._servos.answer(packet)
            if self._byte_s:
                self._free_s = max(now_s, self._free_s) + (len(packet) + len(replies)) * self._byte_s
                if replies:
                    _wait_until(self._free_s)
            if replies:
                os.write(self.master, replies)
        self._rest = data


def _wait_until(due_s: float) -> None:
    ahead_s = due_s - time.perf_counter() - GRANULE_S
    if ahead_s > 0.0:
        time.sleep(ahead_s)
    while time.perf_counter() < due_s:
        pass


def main() -> None:
    """Serve the bus. ``--silence ID,FROM,TO`` makes a servo silent between two points in time (s after the start)."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("link", type=free_path)
    parser.add_argument("--ids", default="1-7")
    parser.add_argument("--make", choices=("feetech", "dynamixel"), default="feetech")
    parser.add_argument("--paced", type=positive, default=0, metavar="BAUD")
    parser.add_argument("--silence", type=silence, metavar="ID,FROM,TO")
    arguments = parser.parse_args()
    kind = DynamixelServos if arguments.make == "dynamixel" else Servos
    try:
        servos = kind(parse_ids(arguments.ids))
        line = SimulatedBus(arguments.link, servos, arguments.paced)
    except DriverError as error:
        parser.error(str(error))
    except OSError as error:
        parser.error(f"{arguments.link} cannot be created: {error.strerror}")
    print("ready", flush=True)
    servo_id, from_s, to_s = arguments.silence or (0, 0.0, 0.0)
    begin_s = time.perf_counter()
    while True:
        line.serve_once()
        if arguments.silence:
            silent = {servo_id} if from_s <= time.perf_counter() - begin_s < to_s else set()
            if silent != servos.silent:
                servos.silence(silent)


if __name__ == "__main__":
    main()
