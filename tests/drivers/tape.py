"""A port for the makers' SDKs and for us that only listens."""

from collections.abc import Sequence


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
