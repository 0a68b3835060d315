"""A line is a port and what is known of its wire: until when it is busy, what is left on it, whether it echoes."""

from typing import Final

from drivers.clock import Clock
from drivers.port import Port

BITS_PER_BYTE: Final = 10.0
GAP_S: Final = 0.0015
"""How long the next piece of an answer may take once some have come."""


class Line:
    """The line that all parts of one bus share."""

    def __init__(self, port: Port, clock: Clock) -> None:
        self.port = port
        self.now = clock.now
        self.byte_s = BITS_PER_BYTE / port.baud
        self.busy_until_s = 0.0
        """Until when what was sent is on the wire."""
        self.clean = False
        """Whether nothing can be left of the last answer to throw away."""
        self.echoes: bool | None = None
        """Half-duplex adapters that join the two wires give back what we send. None until an answer has shown it."""

    def tell(self, packet: bytes) -> None:
        """Send a packet that nobody answers. Its echo, if there is one, is taken off the line at once."""
        self.port.write(packet)
        now_s, on_wire_s = self.now(), len(packet) * self.byte_s
        self.busy_until_s = (self.busy_until_s if self.busy_until_s > now_s else now_s) + on_wire_s
        if self.echoes:
            self.port.read(len(packet), self.busy_until_s + on_wire_s + GAP_S)

    def ask(self, request: bytes) -> float:
        """Send a question; returns when its last byte is on the wire."""
        now_s = self.now()
        self.clean = False
        self.port.write(request)
        return (self.busy_until_s if self.busy_until_s > now_s else now_s) + len(request) * self.byte_s

    def hear(self, request: bytes, size: int, until_s: float) -> bytes:
        """The answer's ``size`` bytes if they come in time, or else what there is of them, without the echo."""
        if self.echoes is False:
            return self.port.read(size, until_s)
        echoed = len(request) if self.echoes else 0
        data = self.port.read(echoed + size, until_s + echoed * self.byte_s)
        if self.echoes is None and data and request.startswith(data):
            # Nobody knew of an echo, and it is so long that there is nothing else yet.
            data += self.port.read(len(request) - len(data) + size, until_s)
        at = data.find(request)
        self.echoes = True if at >= 0 else None
        return data[at + len(request) :] if at >= 0 else data
