"""A serial line: a port and the state of its wire."""

from typing import Final

from drivers.clock import Clock
from drivers.port import Port

BITS_PER_BYTE: Final = 10.0
"""Bits per byte on the wire: a start bit, eight data bits and a stop bit."""
GAP_S: Final = 0.0015
"""Maximum gap between two fragments of a reply, in seconds."""


class Line:
    """The serial line that all parts of one bus share."""

    def __init__(self, port: Port, clock: Clock) -> None:
        self.port = port
        self.now = clock.now
        self.byte_s = BITS_PER_BYTE / port.baud
        self.busy_until_s = 0.0
        """Clock time at which the transmission of the last sent byte ends, in seconds."""
        self.clean = False
        """Whether the last replies were read completely, so that no input has to be discarded."""
        self.echoes: bool | None = None
        """Whether the adapter echoes sent bytes, as some half-duplex adapters do. None until the first reply has shown
        whether it does.
        """

    def send(self, packet: bytes) -> None:
        """Send a packet that has no reply, and read its echo if the adapter echoes."""
        self.port.write(packet)
        now_s, on_wire_s = self.now(), len(packet) * self.byte_s
        self.busy_until_s = (self.busy_until_s if self.busy_until_s > now_s else now_s) + on_wire_s
        if self.echoes:
            self.port.read(len(packet), self.busy_until_s + on_wire_s + GAP_S)

    def send_request(self, request: bytes) -> float:
        """Send a request. Return the clock time at which the transmission of its last byte ends."""
        now_s = self.now()
        self.clean = False
        self.port.write(request)
        return (self.busy_until_s if self.busy_until_s > now_s else now_s) + len(request) * self.byte_s

    def receive(self, request: bytes, size: int, until_s: float) -> bytes:
        """Receive up to ``size`` bytes of replies until ``until_s`` and return them without the echo of the request."""
        if self.echoes is False:
            return self.port.read(size, until_s)
        echoed = len(request) if self.echoes else 0
        data = self.port.read(echoed + size, until_s + echoed * self.byte_s)
        if self.echoes is None and data and request.startswith(data):
            # The bytes received so far may be an unexpected echo, so the replies are still to come.
            data += self.port.read(len(request) - len(data) + size, until_s)
        at = data.find(request)
        self.echoes = True if at >= 0 else None
        return data[at + len(request) :] if at >= 0 else data
