"""Record the bytes and the time of every read and write on a serial port."""

from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

from drivers.clock import Clock
from drivers.port import Port

KEPT: Final = 20_000
"""Maximum number of transfers kept before the loop runs. The set-up of a bus needs several hundred."""


class Transfer(NamedTuple):
    """Bytes of one call to a port."""

    stamp_s: float
    """Time before a write or after a read, in seconds on the loop's clock."""
    port: str
    sent: bool
    """Whether the bytes were written."""
    data: bytes
    """Bytes of the call. Empty after a read that timed out."""


class BusTaps:
    """Taps on all ports of a stack. They share one list of transfers in chronological order."""

    def __init__(self) -> None:
        self._transfers: deque[Transfer] = deque(maxlen=KEPT)

    def tap(self, port: Port, clock: Clock) -> Port:
        """Return a port that records its transfers and otherwise behaves as ``port``."""
        return BusTap(port, clock, self._transfers)

    def take(self) -> tuple[Transfer, ...]:
        """Return all transfers since the last call. Only one thread may call this; another thread may use the ports."""
        transfers = self._transfers
        return tuple(transfers.popleft() for _ in range(len(transfers)))


@dataclass(slots=True)
class BusTap:
    """Port that records all transfers of another port."""

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
