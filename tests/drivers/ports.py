"""Virtual ports that behave like particular adapters."""

from sim_backend.buses.port import VirtualPort
from sim_backend.line.line import DelayedReply


class EchoingPort(VirtualPort):
    """An adapter that echoes all bytes sent."""

    _own = b""

    def write(self, data: bytes) -> None:
        super().write(data)
        self._own += data

    def read(self, size: int, deadline_s: float) -> bytes:
        own, self._own = self._own[:size], self._own[size:]
        return own + super().read(size - len(own), deadline_s)

    def discard_input(self) -> None:
        super().discard_input()
        self._own = b""


class SlowPort(VirtualPort):
    """An adapter that delays received bytes by 16 ms."""

    def write(self, data: bytes) -> None:
        before = len(self._coming)
        super().write(data)
        for at in range(before, len(self._coming)):
            self._coming[at] = DelayedReply(self._clock.now() + 0.016, self._coming[at].data)


class WatchedPort(VirtualPort):
    """A port that records the packets sent, and can delay replies, insert bytes or echo requests."""

    sent: tuple[bytes, ...] = ()
    hold_s = 0.0
    echoes = False

    def write(self, data: bytes) -> None:
        before = len(self._coming)
        super().write(data)
        self.sent += (data,)
        for at in range(before, len(self._coming)):
            self._coming[at] = DelayedReply(self._coming[at].due_s + self.hold_s, self._coming[at].data)
        if self.echoes:
            self._arrived += data

    def give(self, data: bytes) -> None:
        self._arrived += data
