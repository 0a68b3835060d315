"""Parse the parameters of protocol 2.0 group instructions into tuples (ID, address, size or data). No I/O.

Source: ROBOTIS e-manual, "Protocol 2.0". An incomplete last entry is ignored (assumed).
"""

from collections.abc import Iterator
from typing import Final

Span = tuple[int, int, int]
"""ID, address and size."""
Entry = tuple[int, int, bytes]
"""ID, address and data."""

_BULK_HEAD: Final = 5
"""Number of bytes that specify the ID, address and size of one servo in a bulk instruction."""


def sync_spans(parameters: bytes) -> list[Span]:
    """Parse a sync read: an address and a size, followed by the IDs."""
    address, size = _number(parameters, 0), _number(parameters, 2)
    return [(servo_id, address, size) for servo_id in parameters[4:]]


def bulk_spans(parameters: bytes) -> list[Span]:
    """Parse a bulk read: the ID, address and size for each servo."""
    heads = range(0, len(parameters) - _BULK_HEAD + 1, _BULK_HEAD)
    return [(parameters[at], _number(parameters, at + 1), _number(parameters, at + 3)) for at in heads]


def sync_entries(parameters: bytes) -> Iterator[Entry]:
    """Parse a sync write: an address and a size, followed by an ID and ``size`` bytes for each servo."""
    if len(parameters) < 4:
        return
    address, size = _number(parameters, 0), _number(parameters, 2)
    for at in range(4, len(parameters) - size, size + 1):
        yield parameters[at], address, parameters[at + 1 : at + 1 + size]


def bulk_entries(parameters: bytes) -> Iterator[Entry]:
    """Parse a bulk write: the ID, address, size and ``size`` bytes for each servo."""
    at = 0
    while at + _BULK_HEAD <= len(parameters):
        begin = at + _BULK_HEAD
        end = begin + _number(parameters, at + 3)
        if end > len(parameters):
            return
        yield parameters[at], _number(parameters, at + 1), parameters[begin:end]
        at = end


def _number(parameters: bytes, at: int) -> int:
    return int.from_bytes(parameters[at : at + 2], "little")
