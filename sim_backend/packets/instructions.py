"""Instructions on a bus, and the base class of their parsers. No I/O."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Instruction:
    """One packet from the master. ``code`` may be unknown to the servos."""

    servo_id: int
    code: int
    parameters: bytes = b""


class Parser(ABC):
    """Parser that splits a byte stream into instructions. After a malformed packet, only one byte is discarded, so that
    the next packet is not lost."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Number of bytes that belong to an incomplete packet."""
        return len(self._buffer)

    def reset(self) -> None:
        """Discard an incomplete packet, as a servo does after a pause."""
        self._buffer.clear()

    def feed(self, data: bytes) -> Iterator[Instruction]:
        """Yield each instruction when its last byte is consumed.

        While an instruction is being handled, ``pending`` is the number of bytes that follow it.
        """
        self._buffer += data
        return iter(self._next_packet, None)

    @abstractmethod
    def _next_packet(self) -> Instruction | None:
        """Remove the next complete instruction from the buffer and return it. Return None if more bytes are needed."""
