"""Instructions on a wire, and what all parsers of them have in common, whatever the packets. Pure."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Instruction:
    """One packet from the master. ``code`` may be one that no servo knows."""

    servo_id: int
    code: int
    parameters: bytes = b""


class Parser(ABC):
    """Bytes in any portions to instructions. What does not hold together costs one byte, not a packet."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """How many bytes are waiting for the rest of their packet."""
        return len(self._buffer)

    def reset(self) -> None:
        """Forget a half packet, as a servo does after a pause."""
        self._buffer.clear()

    def feed(self, data: bytes) -> Iterator[Instruction]:
        """Yield each instruction as soon as its last byte is consumed.

        While one is being handled, ``pending`` is the number of bytes that came after it.
        """
        self._buffer += data
        return iter(self._next_packet, None)

    @abstractmethod
    def _next_packet(self) -> Instruction | None:
        """The next whole one, taken from the buffer; None until more bytes come."""
