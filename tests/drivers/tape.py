"""A port for the makers' SDKs and for us that only listens."""

from collections.abc import Sequence

from sim_backend.clock import SimulatedClock


class Tape:
    """What the SDK and we take for a port: keeps what is sent, never answers."""

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
    """Where answers are waited for: our wait is over at once, and so is the SDKs'."""

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
