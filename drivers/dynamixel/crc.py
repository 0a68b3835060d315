"""The checksum of Dynamixel protocol 2.0: CRC-16, polynomial 0x8005, from zero, nothing reflected."""

from struct import unpack
from typing import Final

_POLYNOMIAL: Final = 0x8005


def _entry(byte: int) -> int:
    value = byte << 8
    for _ in range(8):
        value = value << 1 ^ (_POLYNOMIAL if value & 0x8000 else 0)
    return value & 0xFFFF


_TABLE: Final = tuple(_entry(byte) for byte in range(256))
WORDS: Final = tuple((first << 8 & 0xFF00) ^ _TABLE[first >> 8 ^ low] for first in _TABLE for low in range(256))
"""What two bytes at once, high byte first, make of a checksum: half the steps of a table by bytes."""


def crc16(data: bytes, value: int = 0) -> int:
    """The checksum of ``data``, behind bytes whose checksum is ``value``; it goes over the wire low byte first."""
    odd = len(data) & 1
    if odd:
        value = (value << 8 & 0xFF00) ^ _TABLE[value >> 8 ^ data[0]]
    for word in unpack(f">{len(data) // 2}H", data[odd:]):
        value = WORDS[value ^ word]
    return value
