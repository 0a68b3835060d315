"""A tap on a serial line: what went over it in each call, and when."""

from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

from drivers.clock import Clock
from drivers.port import Port

KEPT: Final = 20_000
"""So many transfers wait for a loop that does not run: those of setting up a line of servos are some hundred."""


class Transfer(NamedTuple):
    """The bytes of one call, written or read."""

    stamp_s: float
    """When they were handed over to be sent, or when the call that read them came back; on the loop's clock."""
    port: str
    sent: bool
    data: bytes
    """Empty where nothing came in the time that there was."""


class BusTaps:
    """The taps on all lines of a stack. They share one list, in which the transfers stand in their order."""

    def __init__(self) -> None:
        self._transfers: deque[Transfer] = deque(maxlen=KEPT)

    def tap(self, port: Port, clock: Clock) -> Port:
        """The same port, with a tap."""
        return BusTap(port, clock, self._transfers)

    def take(self) -> tuple[Transfer, ...]:
        """All transfers since the last time. For one thread; another may use the ports meanwhile."""
        transfers = self._transfers
        return tuple(transfers.popleft() for _ in range(len(transfers)))


@dataclass(slots=True)
class BusTap:
    """A port that notes what goes over it, and else is the port below."""

    port: Port
    clock: Clock
    transfers: deque[Transfer]

    @property
    def name(self) -> str:
        return self.port.name

    @property
    def baud(self) -> int:
        return self.port.baud

    def write(self, data: bytes) -> None:
        self.transfers.append(Transfer(self.clock.now(), self.port.name, True, data))
        self.port.write(data)

    def read(self, size: int, deadline_s: float) -> bytes:
        data = self.port.read(size, deadline_s)
        self.transfers.append(Transfer(self.clock.now(), self.port.name, False, data))
        return data

    def discard_input(self) -> None:
        self.port.discard_input()

    def set_baud(self, baud: int) -> None:
        self.port.set_baud(baud)

    def close(self) -> None:
        self.port.close()
