"""Connect the manufacturers' packet handlers to a Port.

The SDKs' own PortHandlers wait at 100 % CPU load. Feetech's PortHandler flushes the output instead of discarding old
input. This adapter waits without CPU load and discards the input.
"""

from typing import Final

import dynamixel_sdk
import scservo_sdk

from drivers.port.line import BITS_PER_BYTE, Line
from drivers.protocol import v1

CORRUPT: Final = (scservo_sdk.COMM_RX_CORRUPT, dynamixel_sdk.COMM_RX_CORRUPT)
"""Result codes of both SDKs for a corrupt reply. The other codes are the same in both SDKs, or mean that no reply
arrived.
"""
_GRACE_S = 0.034
"""Reply timeout of the SDK without the transmission time, in seconds: two USB latency timers of 16 ms and 2 ms."""
_FLOOD_S = 0.1  # extra time after the deadline for reading all bytes that arrived before it


class SdkAdapter:
    """PortHandler for scservo_sdk and dynamixel_sdk, which prescribe the method names."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._port = line.port
        self._sent = b""
        self._held_back, self._delivered, self._echo_delivered = b"", b"", False
        self._deadline_s = 0.0

    def corrected_result(self, result: int) -> int:
        """Return the result code of an SDK, corrected for echoes."""
        if result != dynamixel_sdk.COMM_SUCCESS and self._sent:  # the adapter may no longer echo
            self._line.echoes = self._line.echoes and None
        return dynamixel_sdk.COMM_RX_CORRUPT if self._echo_delivered else result

    @property
    def is_using(self) -> bool:
        """Lock flag of the SDK, which always stays False.

        A lock is not needed, because one thread owns the port. In addition, an exception would leave the lock closed.
        """
        return False

    @is_using.setter
    def is_using(self, value: bool) -> None: ...

    def getBaudRate(self) -> int:
        return self._port.baud

    def clearPort(self) -> None:
        self._port.discard_input()

    def writePort(self, packet: list[int]) -> int:
        self._sent, self._held_back, self._delivered, self._echo_delivered = bytes(packet), b"", b"", False
        self._port.write(self._sent)
        return len(packet)

    def readPort(self, length: int) -> bytes:
        # For a frame with an impossibly small length, the SDKs request a negative number of bytes. The SDKs do not
        # check the time while bytes arrive, so a read would never end on a flooded bus.
        if length <= 0 or self._line.now() >= self._deadline_s + _FLOOD_S:
            return b""
        data = self._held_back + self._port.read(length, self._deadline_s)
        if not self._sent or (self._line.echoes is False and _is_ping(self._sent)):
            return data
        return self._without_echo(data)

    def _without_echo(self, data: bytes) -> bytes:
        """Remove the echo of the request, which the SDK would mistake for a reply.

        If the adapter is known to echo, all bytes before the echo are discarded. Otherwise, bytes that may be the start
        of an echo are held back. If noise precedes an echo, the SDK may receive the echo. The result of the SDK is then
        marked as corrupt.
        """
        at = data.find(self._sent)
        if at >= 0:
            data = data[at + len(self._sent) :]
        elif self._line.echoes or (not self._delivered and self._sent.startswith(data)):
            self._held_back = data
            return b""
        else:
            self._delivered += data
            self._echo_delivered = self._sent in self._delivered
            self._held_back = b""
        if at >= 0 or self._echo_delivered:
            self._line.echoes = True
            self._sent, self._held_back = b"", b""
        return data

    def setPacketTimeout(self, packet_length: int) -> None:
        wire_s = packet_length * BITS_PER_BYTE / self._port.baud
        self._deadline_s = self._line.now() + wire_s + _GRACE_S

    def setPacketTimeoutMillis(self, msec: float) -> None:
        self._deadline_s = self._line.now() + msec / 1000.0

    def isPacketTimeout(self) -> bool:
        return self._line.now() >= self._deadline_s


def _is_ping(packet: bytes) -> bool:
    """Return whether a packet is a ping of protocol 1.0. A servo with a voltage alarm replies with the same bytes."""
    return len(packet) == v1.OVERHEAD and packet[4] == v1.PING
