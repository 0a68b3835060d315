"""Record the bytes and the time of every read and write on a serial port."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Generic, NamedTuple, TypeVar

from drivers.clock import Clock
from drivers.port import Port

AnyPort = TypeVar("AnyPort", bound=Port)
KEPT: Final = 20_000
"""Maximum number of transfers kept before the loop starts. Setting up a bus requires several hundred transfers."""


class Transfer(NamedTuple):
    """Bytes written to or read from a port by one call."""

    stamp_s: float
    """Time just before a write or just after a read, in seconds on the loop's clock."""
    port: str
    sent: bool
    """True if the bytes were written, False if they were read."""
    data: bytes
    """Bytes written or read. Empty after a read that timed out."""


class BusTaps:
    """Taps on all ports of a stack. The taps share one list of transfers in chronological order."""

    def __init__(self) -> None:
        self._transfers: deque[Transfer] = deque(maxlen=KEPT)

    def tap(self, port: Port, clock: Clock) -> Port:
        """Return a port that records its transfers and otherwise behaves like ``port``."""
        return BusTap(port, clock, self._transfers)

    def take(self) -> tuple[Transfer, ...]:
        """Return all transfers since the last call.

        Only one thread may call this method. A different thread may use the ports.
        """
        transfers = self._transfers
        return tuple(transfers.popleft() for _ in range(len(transfers)))


@dataclass(slots=True)
class BusTap(Generic[AnyPort]):
    """Port that records all transfers of another port."""

    port: AnyPort
    clock: Clock
    transfers: deque[Transfer] = field(default_factory=deque)
    on_write: Callable[[bytes], None] | None = None
    """Function called with the bytes of each write before they are written."""

    @property
    def sent(self) -> list[tuple[float, bytes]]:
        """Time and bytes of each write."""
        return [(one.stamp_s, one.data) for one in self.transfers if one.sent]

    @property
    def received(self) -> list[tuple[float, bytes]]:
        """Time and bytes of each read."""
        return [(one.stamp_s, one.data) for one in self.transfers if not one.sent]

    @property
    def name(self) -> str:
        return self.port.name

    @property
    def baud(self) -> int:
        return self.port.baud

    def write(self, data: bytes) -> None:
        stamp_s = self.clock.now()
        if self.on_write is not None:
            self.on_write(data)
        self.port.write(data)
        self.transfers.append(Transfer(stamp_s, self.port.name, True, data))

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
