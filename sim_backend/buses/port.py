"""Virtual bus that implements ``drivers.port.Port`` without using the operating system.

On a simulated clock, a read advances the clock to the time at which the bytes arrive. The real driver therefore runs in
one thread, faster than real time, and every run produces the same bytes.
"""

from collections import deque
from typing import Any

from drivers.clock import Clock
from drivers.driver_errors import PortLost, PortMissing
from sim_backend.line.line import DelayedReply, ServoLine


class VirtualPort:
    """The computer's end of a ``ServoLine``."""

    def __init__(self, bus: ServoLine[Any], clock: Clock, *, baud: int = 1_000_000, name: str = "virtual") -> None:
        self._bus = bus
        self._clock = clock
        self._baud = baud
        self._name = name
        self._gone = ""
        self._coming: deque[DelayedReply] = deque()
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
        """Discard the bytes that have arrived. Bytes that are still on the wire arrive later, as on a real bus."""
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
        """Whether the port is neither closed nor lost."""
        return not self._gone

    def unplug(self) -> None:
        """Unplug the adapter. Make every method raise ``PortLost`` from now on."""
        self._gone = "was unplugged: plug it in and open the port again"

    def _alive(self) -> None:
        if self._gone:
            raise PortLost(f"{self._name} {self._gone}")

    def _collect(self) -> None:
        now_s = self._clock.now()
        while self._coming and self._coming[0].due_s <= now_s:
            self._arrived += self._coming.popleft().data


class VirtualAdapter:
    """The adapter at the computer's end of a bus. The adapter can be opened by name, unplugged, and plugged in under
    any name."""

    def __init__(self, bus: ServoLine[Any], clock: Clock, name: str = "virtual") -> None:
        self.name = name
        self._bus, self._clock = bus, clock
        self._there: str | None = name
        self._ports: list[VirtualPort] = []

    def open(self, name: str, baud: int = 1_000_000) -> VirtualPort:
        """Open a port to the bus. Raises PortMissing if no adapter has this name now."""
        if name != self._there:
            there = self._there or "none"
            raise PortMissing(f"there is no {name}: plug in the adapter or choose another port (present: {there})")
        port = VirtualPort(self._bus, self._clock, baud=baud, name=name)
        self._ports = [*(port for port in self._ports if port.is_open), port]
        return port

    @property
    def reachable(self) -> bool:
        """Whether the adapter can be opened under its original name."""
        return self._there == self.name

    def unplug(self) -> None:
        """Unplug the adapter. All open ports are lost."""
        self._there = None
        for port in self._ports:
            if port.is_open:
                port.unplug()

    def plug(self, name: str | None = None) -> None:
        """Plug the adapter in under its original name or a different name. Ports that were lost stay lost and must be
        opened again."""
        self._there = name or self.name
