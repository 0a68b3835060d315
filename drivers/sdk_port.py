"""The makers' packet handlers over our Port.

The SDKs do all single-servo instructions. Their own PortHandlers spin at 100 % CPU while they wait, and
Feetech's flushes output where it should drop stale input; this one waits on the port and drops the input.
"""

import math
from typing import Final

import dynamixel_sdk
import scservo_sdk

from drivers.clock import Clock
from drivers.echo import Echo
from drivers.errors import ServoCorrupt, ServoSilent
from drivers.port import Port

_CORRUPT: Final = (scservo_sdk.COMM_RX_CORRUPT, dynamixel_sdk.COMM_RX_CORRUPT)
"""The other numbers are the same in both, or mean no answer."""
_GRACE_S = 0.034
"""What the SDK grants a reply beside its time on the wire (two 16 ms USB latency timers and 2 ms)."""


class SdkPort:
    """What scservo_sdk and dynamixel_sdk expect of a PortHandler. The method names are theirs."""

    def __init__(self, port: Port, clock: Clock, echo: Echo | None = None) -> None:
        self._port = port
        self._clock = clock
        self._echo = echo or Echo()
        self._sent = b""
        self._doubtful = b""
        self._deadline_s = 0.0
        self.latest_s = math.inf
        """When to give up whatever the SDK would grant: a cycle has its own deadline."""

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
        self._sent, self._doubtful = bytes(packet), b""
        self._port.write(self._sent)
        return len(packet)

    def readPort(self, length: int) -> bytes:
        # Of a frame that claims to be shorter than any, the SDKs ask for less than nothing.
        if length <= 0:
            return b""
        data = self._doubtful + self._port.read(length, self._deadline_s)
        if self._echo.present is False or not self._sent:
            return data
        return self._without_echo(data)

    def _without_echo(self, data: bytes) -> bytes:
        """The SDK would take our own request for an answer. Held back until it is told apart."""
        sent = self._sent
        if len(data) < len(sent) and sent.startswith(data):
            self._doubtful = data
            return b""
        self._sent, self._doubtful = b"", b""
        return data[len(sent) :] if data.startswith(sent) else data

    def setPacketTimeout(self, packet_length: int) -> None:
        wire_s = packet_length * 10.0 / self._port.baud
        self._deadline_s = min(self._clock.now() + wire_s + _GRACE_S, self.latest_s)

    def setPacketTimeoutMillis(self, msec: float) -> None:
        self._deadline_s = self._clock.now() + msec / 1000.0

    def isPacketTimeout(self) -> bool:
        return self._clock.now() >= self._deadline_s


def raise_for(servo_id: int, result: int) -> None:
    """Turn an SDK's result code into an error."""
    if result in _CORRUPT:
        raise ServoCorrupt(servo_id, "answered with a broken packet: check the cable's plugs")
    if result != dynamixel_sdk.COMM_SUCCESS:
        raise ServoSilent(servo_id, "does not answer: check its power and cable, its ID and the baud rate")
