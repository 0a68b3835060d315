"""Ping servos on an unknown bus, at the current baud rate of the port.

In protocol 1.0, the echo of a ping is identical to the reply of a servo with a voltage alarm. A broadcast ping reveals
whether the adapter echoes requests, because no servo has the broadcast ID 254.
"""

from dataclasses import dataclass
from types import ModuleType
from typing import Final

from drivers.clock import Clock
from drivers.port import Port
from drivers.port.line import BITS_PER_BYTE
from drivers.protocol import v1, v2
from drivers.servos import sts

GRACE_S: Final = 0.034
"""Time allowed for a reply in addition to its transmission: two latency timers of 16 ms, as in the vendors' SDKs."""
PING_GRACE_S: Final = 0.02
"""Time allowed for the reply to a single ping: one latency timer, the longest return delay, and a margin."""
V1_REPLY, V2_REPLY = 6, 14
V1_SLOT: Final = 9
"""Length of the time slot in which an STS replies to a broadcast ping, in byte times. Each ID has its own slot."""
V2_TURN_S: Final = 0.003
"""Time that each Dynamixel protocol 2.0 servo waits for the previous servo, according to the ROBOTIS SDK."""


@dataclass(frozen=True, slots=True)
class Heard:
    """Bytes received after pings."""

    whole: frozenset[int] = frozenset()
    """IDs from valid replies."""
    broken: frozenset[int] = frozenset()
    """IDs from replies with wrong checksums."""
    noise: int = 0
    """Number of other bytes."""

    @property
    def anything(self) -> bool:
        """Whether any byte was received."""
        return bool(self.whole or self.broken or self.noise)

    def __or__(self, other: "Heard") -> "Heard":
        whole = self.whole | other.whole
        return Heard(whole, (self.broken | other.broken) - whole, self.noise + other.noise)


class Wire:
    """A bus that is pinged at one baud rate with one protocol."""

    def __init__(self, port: Port, clock: Clock, packets: ModuleType) -> None:
        self._port, self._clock, self.packets = port, clock, packets
        self._byte_s = BITS_PER_BYTE / port.baud
        self._echoes: bool | None = None
        self._reply = V1_REPLY if packets is v1 else V2_REPLY
        self.largest_id = 253 if packets is v1 else v2.LARGEST_ID

    def broadcast(self) -> Heard:
        """Ping all servos at once. The timeout includes the time slots of all servos."""
        request = self.packets.packet(self.packets.BROADCAST_ID, self.packets.PING, b"")
        turns = self.largest_id + 1
        data = self._ask(request, turns * self._reply + len(request), turns * self._turn_s() + GRACE_S)
        self._echoes = request in data
        return self._judged(data.replace(request, b"", 1))

    def learn_echo(self) -> None:
        """Find out whether the adapter echoes requests. In protocol 2.0, an echo cannot be mistaken for a reply."""
        if self.packets is v1:
            self.broadcast()

    def ping(self, servo_id: int) -> Heard:
        """Ping one servo. The result may include a late reply from another servo."""
        request = self.packets.packet(servo_id, self.packets.PING, b"")
        data = self._ask(
            request,
            self._reply + (0 if self._echoes is False else len(request)),
            self._reply * self._byte_s + PING_GRACE_S,
        )
        return self._judged(data if self._echoes is False else data.replace(request, b"", 1))

    def _ask(self, request: bytes, size: int, wait_s: float) -> bytes:
        self._port.discard_input()
        self._port.write(request)
        data: bytes = self._port.read(size, self._clock.now() + len(request) * self._byte_s + wait_s)
        return data

    def _turn_s(self) -> float:
        """Return the time slot of each servo for a broadcast ping. In protocol 1.0, only STS servos have time slots."""
        if self.packets is v2:
            return V2_REPLY * self._byte_s + V2_TURN_S
        return V1_SLOT * self._byte_s if self._port.baud in sts.BAUD_RATES else 0.0

    def _judged(self, data: bytes) -> Heard:
        if self.packets is v1:
            return _v1_replies(data)
        decoder = v2.ReplyDecoder(3)
        replies = decoder.feed(data) + decoder.finish()
        whole = frozenset(reply.servo_id for reply in replies)
        broken = frozenset(i for i in decoder.corrupt_ids if i <= v2.LARGEST_ID) - whole
        return Heard(whole, broken, len(data) - len(whole) * V2_REPLY)


def _v1_replies(data: bytes) -> Heard:
    """Find replies without data. The driver's decoder finds only replies with data."""
    whole: set[int] = set()
    broken: set[int] = set()
    at = noise = 0
    while (start := data.find(v1.HEADER, at)) >= 0 and len(frame := data[start : start + V1_REPLY]) == V1_REPLY:
        noise += start - at
        if frame == v1.packet(frame[2], frame[4], b"") and frame[2] <= 253:
            whole.add(frame[2])
            at = start + V1_REPLY
            continue
        if frame[2] <= 253 and frame[3] == 2:
            broken.add(frame[2])
        at = start + 1
        noise += 1
    return Heard(frozenset(whole), frozenset(broken - whole), noise + len(data) - at)
