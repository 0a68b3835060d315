"""dynamixel-sdk's packet handler over our Port.

The SDK does all single-servo instructions. Its own PortHandler spins at 100 % CPU while it waits;
this one waits on the port.
"""

from drivers.clock import Clock
from drivers.port import Port

_GRACE_S = 0.034
"""What the SDK grants a reply beside its time on the wire (two 16 ms USB latency timers and 2 ms)."""


class SdkPort:
    """What dynamixel_sdk expects of a PortHandler. The method names are the SDK's."""

    def __init__(self, port: Port, clock: Clock) -> None:
        self._port = port
        self._clock = clock
        self._deadline_s = 0.0

    @property
    def is_using(self) -> bool:
        """The SDK's lock. One thread owns the port, and an exception would leave the lock shut for good."""
        return False

    @is_using.setter
    def is_using(self, value: bool) -> None: ...

    def getBaudRate(self) -> int:
        return self._port.baud

    def clearPort(self) -> None:
        self._port.discard_input()

    def writePort(self, packet: list[int]) -> int:
        self._port.write(bytes(packet))
        return len(packet)

    def readPort(self, length: int) -> bytes:
        # Of a frame that claims to be shorter than any, the SDK asks for less than nothing.
        return self._port.read(length, self._deadline_s) if length > 0 else b""

    def setPacketTimeout(self, packet_length: int) -> None:
        wire_s = packet_length * 10.0 / self._port.baud
        self._deadline_s = self._clock.now() + wire_s + _GRACE_S

    def setPacketTimeoutMillis(self, msec: float) -> None:
        self._deadline_s = self._clock.now() + msec / 1000.0

    def isPacketTimeout(self) -> bool:
        return self._clock.now() >= self._deadline_s
