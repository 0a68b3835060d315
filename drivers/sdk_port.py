"""The makers' packet handlers over our Port.

The SDKs do all single-servo instructions. Their own PortHandlers spin at 100 % CPU while they wait, and
Feetech's flushes output where it should drop stale input; this one waits on the port and drops the input.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import dynamixel_sdk
import scservo_sdk

from drivers.clock import Clock
from drivers.echo import Echo
from drivers.errors import ServoCorrupt, ServoSilent
from drivers.owed import HELD_S
from drivers.port import Port

_CORRUPT: Final = (scservo_sdk.COMM_RX_CORRUPT, dynamixel_sdk.COMM_RX_CORRUPT)
"""The other numbers are the same in both, or mean no answer."""
_MANY: Final = 4096
"""More bytes than can come in that time."""
_GRACE_S = 0.034
"""What the SDK grants a reply beside its time on the wire (two 16 ms USB latency timers and 2 ms)."""
_READ_SIZE: Final = 26
"""Bytes on the wire for reading one register, request and reply, in the longest of the protocols."""


class SdkPort:
    """What scservo_sdk and dynamixel_sdk expect of a PortHandler. The method names are theirs."""

    def __init__(self, port: Port, clock: Clock, echo: Echo | None = None) -> None:
        self._port = port
        self._clock = clock
        self._echo = echo or Echo()
        self._sent = b""
        self._doubtful, self._given, self._mixed = b"", b"", False
        self._deadline_s = 0.0
        self.sent_s = 0.0
        """When the last instruction went out."""
        self._owed_until_s: dict[int, float] = {}
        self.latest_s = math.inf
        """When to give up whatever the SDK would grant: a cycle has its own deadline."""

    @contextmanager
    def until(self, servo_id: int, deadline_s: float | None) -> Iterator[None]:
        """One read that is given up at the deadline, if there is one; ServoSilent at once where there is no time."""
        if deadline_s is None:
            yield
            return
        if self._clock.now() + _READ_SIZE * 10.0 / self._port.baud >= deadline_s:
            raise ServoSilent(servo_id, "was not asked: the cycle was over")
        self.latest_s = deadline_s
        try:
            yield
        finally:
            self.latest_s = math.inf

    def transact(self, servo_id: int, instruct: Callable[[], tuple[Any, int, int]]) -> tuple[Any, int]:
        """One instruction by the SDK, which returns the reply, a result code and the reply's error byte.

        Raises ServoSilent or ServoCorrupt. A reply does not say what it answers: while one of this servo may
        still come, nothing is sent to it.
        """
        self._let_pass(servo_id)
        self.owe(servo_id)  # before it is: an interrupt leaves the reply on its way
        reply, result, error = instruct()
        self.owe(servo_id)
        if result != dynamixel_sdk.COMM_SUCCESS and self._sent:  # perhaps there is no echo any more
            self._echo.present = self._echo.present and None
        raise_for(servo_id, dynamixel_sdk.COMM_RX_CORRUPT if self._mixed else result)
        del self._owed_until_s[servo_id]
        return reply, error

    def owe(self, servo_id: int) -> None:
        """The right answer to the last instruction has not come, and may still."""
        self._owed_until_s[servo_id] = self._clock.now() + HELD_S

    def _let_pass(self, servo_id: int) -> None:
        """Wait until no reply to a former instruction can come any more; in a cycle there is no time for that."""
        until_s = self._owed_until_s.get(servo_id, -math.inf)
        if self.latest_s < math.inf and self._clock.now() < until_s:
            raise ServoSilent(servo_id, "may still answer the last question, and is not asked before that")
        while self._clock.now() < until_s:
            self._port.read(_MANY, until_s)

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
        self.sent_s = self._clock.now()
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
        """The SDK would take our own request for an answer. Held back until it is told apart.

        Where there surely is an echo, nothing before it is an answer. Where there may be none, only what begins like
        it is held back: the SDK may get a piece of it behind noise, and then whatever it makes of that is ``_mixed``.
        """
        at = data.find(self._sent)
        if at >= 0:
            data = data[at + len(self._sent) :]
        elif self._echo.present or (not self._given and self._sent.startswith(data)):
            self._doubtful = data
            return b""
        else:
            self._given += data
            self._mixed = self._sent in self._given
            self._doubtful = b""
        if at >= 0 or self._mixed:
            self._echo.present = True
            self._sent, self._doubtful = b"", b""
        return data

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
