"""The adapter that puts the makers' packet handlers over our Port.

Their own PortHandlers spin at 100 % CPU while they wait, and Feetech's flushes output where it should drop stale
input; this one waits on the port and drops the input.
"""

from typing import Final

import dynamixel_sdk
import scservo_sdk

from drivers.port.line import BITS_PER_BYTE, Line

CORRUPT: Final = (scservo_sdk.COMM_RX_CORRUPT, dynamixel_sdk.COMM_RX_CORRUPT)
"""The other numbers are the same in both, or mean no answer."""
_GRACE_S = 0.034
"""What the SDK grants a reply beside its time on the wire (two 16 ms USB latency timers and 2 ms)."""
_NEVER_SILENT_S = 0.1  # behind the deadline: in less, all that had come by then is read


class SdkAdapter:
    """The PortHandler that scservo_sdk and dynamixel_sdk expect. The method names are theirs."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._port = line.port
        self._sent = b""
        self._doubtful, self._given, self._mixed = b"", b"", False
        self._deadline_s = 0.0

    def judged(self, result: int) -> int:
        """An SDK's result code, with what it does not know of echoes."""
        if result != dynamixel_sdk.COMM_SUCCESS and self._sent:  # perhaps there is no echo any more
            self._line.echoes = self._line.echoes and None
        return dynamixel_sdk.COMM_RX_CORRUPT if self._mixed else result

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
        self._sent, self._doubtful, self._given, self._mixed = bytes(packet), b"", b"", False
        self._port.write(self._sent)
        return len(packet)

    def readPort(self, length: int) -> bytes:
        # Of a frame that claims to be shorter than any, the SDKs ask for less than nothing. While bytes come they never
        # look at the time, and a line that is never silent has always some.
        if length <= 0 or self._line.now() >= self._deadline_s + _NEVER_SILENT_S:
            return b""
        data = self._doubtful + self._port.read(length, self._deadline_s)
        if self._line.echoes is False or not self._sent:
            return data
        return self._without_echo(data)

    def _without_echo(self, data: bytes) -> bytes:
        """The SDK would take our own request for an answer. Held back until it is told apart.

        Where there surely is an echo, nothing before it is an answer. Where there may be none, only what begins like
        it is held back: the SDK may get a piece of it behind noise, and then whatever it makes of that is ``_mixed``.
        """
        at = data.find(self._sent)
        if at >= 0:
            data = data[at + len(self._sent) :]
        elif self._line.echoes or (not self._given and self._sent.startswith(data)):
            self._doubtful = data
            return b""
        else:
            self._given += data
            self._mixed = self._sent in self._given
            self._doubtful = b""
        if at >= 0 or self._mixed:
            self._line.echoes = True
            self._sent, self._doubtful = b"", b""
        return data

    def setPacketTimeout(self, packet_length: int) -> None:
        wire_s = packet_length * BITS_PER_BYTE / self._port.baud
        self._deadline_s = self._line.now() + wire_s + _GRACE_S

    def setPacketTimeoutMillis(self, msec: float) -> None:
        self._deadline_s = self._line.now() + msec / 1000.0

    def isPacketTimeout(self) -> bool:
        return self._line.now() >= self._deadline_s
