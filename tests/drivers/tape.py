"""Ports that record requests of the SDKs and of the bus."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from sim_backend.clock import SimulatedClock


class Tape:
    """A port for the SDK and the bus that records the packets sent and never receives a reply."""

    name = "tape"
    baud = 1_000_000
    is_using = False

    def __init__(self) -> None:
        self.sent = b""

    def clearPort(self) -> None: ...
    def setPacketTimeout(self, packet_length: int) -> None: ...
    def discard_input(self) -> None: ...
    def close(self) -> None: ...

    def writePort(self, packet: Sequence[int]) -> int:
        self.sent += bytes(packet)
        return len(packet)

    def write(self, data: bytes) -> None:
        self.sent += data

    def read(self, size: int, deadline_s: float) -> bytes:
        return b""


class SilentTape(Tape):
    """A tape on which waits of the bus and of the SDKs end immediately."""

    def __init__(self) -> None:
        super().__init__()
        self.clock = SimulatedClock()

    def read(self, size: int, deadline_s: float) -> bytes:
        self.clock.sleep_until(deadline_s)
        return b""

    def readPort(self, length: int) -> bytes:
        return b""

    def isPacketTimeout(self) -> bool:
        return True

    def setPacketTimeoutMillis(self, msec: float) -> None: ...

    def getBaudRate(self) -> int:
        return self.baud


class ScriptedPort(Tape):
    """A port that answers each write at once with the next of ``answers``, and is silent after the last one."""

    def __init__(self, clock: SimulatedClock, *answers: bytes) -> None:
        super().__init__()
        self.clock = clock
        self.answers = list(answers)
        self.input = b""
        self.reads = 0

    def write(self, data: bytes) -> None:
        super().write(data)
        self.input += self.answers.pop(0) if self.answers else b""

    def read(self, size: int, deadline_s: float) -> bytes:
        self.reads += 1
        if len(self.input) < size:
            self.clock.sleep_until(deadline_s)
        data, self.input = self.input[:size], self.input[size:]
        return data

    def discard_input(self) -> None:
        self.input = b""


class SdkPackets:
    """Packets for several servos that an official SDK sends."""

    def __init__(self, sdk: Any, handler: Any) -> None:
        self.sdk, self.handler = sdk, handler

    def sync_read(self, servo_ids: Sequence[int], address: int, size: int) -> bytes:
        tape = Tape()
        group = self.sdk.GroupSyncRead(tape, self.handler, address, size)
        for servo_id in servo_ids:
            assert group.addParam(servo_id)
        assert group.txPacket() == self.sdk.COMM_SUCCESS
        return tape.sent

    def sync_write(self, address: int, size: int, data: Mapping[int, bytes]) -> bytes:
        tape = Tape()
        group = self.sdk.GroupSyncWrite(tape, self.handler, address, size)
        for servo_id, content in data.items():
            assert group.addParam(servo_id, list(content))
        assert group.txPacket() == self.sdk.COMM_SUCCESS
        return tape.sent


def one_bit_flipped(data: bytes) -> Iterator[bytes]:
    """Yield the data with each of its bits flipped in turn."""
    for bit in range(len(data) * 8):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        yield bytes(flipped)
