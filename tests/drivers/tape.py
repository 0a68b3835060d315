"""A port that records requests of the SDKs and of the bus."""

from collections.abc import Sequence

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
