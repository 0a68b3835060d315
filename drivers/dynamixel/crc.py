"""The checksum of Dynamixel protocol 2.0: CRC-16, polynomial 0x8005, from zero, nothing reflected."""

from typing import Final

_POLYNOMIAL: Final = 0x8005


def _entry(byte: int) -> int:
    value = byte << 8
    for _ in range(8):
        value = value << 1 ^ (_POLYNOMIAL if value & 0x8000 else 0)
    return value & 0xFFFF


_TABLE: Final = tuple(_entry(byte) for byte in range(256))


def crc16(data: bytes) -> int:
    """The checksum of ``data``; it goes over the wire low byte first."""
    value = 0
    for byte in data:
        value = (value << 8 & 0xFF00) ^ _TABLE[value >> 8 ^ byte]
    return value
