"""The virtual bus as a ``drivers.port.Port``, without any operating system in between.

On a simulated clock a read jumps to the arrival of the bytes, so the real driver runs in one
thread, faster than real time, and every run gives the same bytes.
"""

from collections import deque
from typing import Any

from drivers.clock import Clock
from drivers.errors import PortLost, PortMissing
from sim_backend.line.line import Reply, ServoLine


class VirtualPort:
    """One end of the wire of a ``ServoLine``."""

    def __init__(self, bus: ServoLine[Any], clock: Clock, *, baud: int = 1_000_000, name: str = "virtual") -> None:
        self._bus = bus
        self._clock = clock
        self._baud = baud
        self._name = name
        self._gone = ""
        self._coming: deque[Reply] = deque()
        self._arrived = bytearray()
        bus.advance(clock.now())

    @property
    def name(self) -> str:
        return self._name

    @property
    def baud(self) -> int:
        return self._baud

    def write(self, data: bytes) -> None:
        self._alive()
        self._coming.extend(self._bus.receive(data, self._clock.now(), self._baud))

    def read(self, size: int, deadline_s: float) -> bytes:
        self._alive()
        self._collect()
        while len(self._arrived) < size and self._coming and self._coming[0].due_s <= deadline_s:
            self._clock.sleep_until(self._coming[0].due_s)
            self._collect()
        if len(self._arrived) < size:
            self._clock.sleep_until(deadline_s)
            self._collect()
        data = bytes(self._arrived[:size])
        del self._arrived[:size]
        return data

    def discard_input(self) -> None:
        """Drop what has arrived. What is still on the wire comes later, as on a real line."""
        self._alive()
        self._collect()
        self._arrived.clear()

    def set_baud(self, baud: int) -> None:
        self._alive()
        self._baud = baud

    def close(self) -> None:
        self._gone = self._gone or "was closed"
        self._coming.clear()
        self._arrived.clear()

    @property
    def is_open(self) -> bool:
        """Whether it was neither closed nor lost."""
        return not self._gone

    def unplug(self) -> None:
        """Pull the adapter: from now on every method raises ``PortLost``."""
        self._gone = "was unplugged: plug it in and open it again"

    def _alive(self) -> None:
        if self._gone:
            raise PortLost(f"{self._name} {self._gone}")

    def _collect(self) -> None:
        now_s = self._clock.now()
        while self._coming and self._coming[0].due_s <= now_s:
            self._arrived += self._coming.popleft().data


class VirtualAdapter:
    """The adapter at the end of a line: opened by its name, pulled out, put back under this name or another."""

    def __init__(self, bus: ServoLine[Any], clock: Clock, name: str = "virtual") -> None:
        self.name = name
        self._bus, self._clock = bus, clock
        self._there: str | None = name
        self._ports: list[VirtualPort] = []

    def open(self, name: str, baud: int = 1_000_000) -> VirtualPort:
        """A port to the line. Raises PortMissing where no adapter has this name now."""
        if name != self._there:
            there = self._there or "none"
            raise PortMissing(f"there is no {name}: plug in the adapter or name another port (there is {there})")
        port = VirtualPort(self._bus, self._clock, baud=baud, name=name)
        self._ports = [*(port for port in self._ports if port.is_open), port]
        return port

    @property
    def reachable(self) -> bool:
        """Whether it can be opened under its own name."""
        return self._there == self.name

    def unplug(self) -> None:
        """Pull it: all open ports are lost."""
        self._there = None
        for port in self._ports:
            if port.is_open:
                port.unplug()

    def plug(self, name: str | None = None) -> None:
        """Put it back, under its former name or another. What was lost stays lost: it is opened again."""
        self._there = name or self.name
