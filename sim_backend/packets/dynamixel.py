"""Servo side of Dynamixel protocol 2.0: parse instruction packets and build status packets. No I/O.

Source: ROBOTIS e-manual, "Protocol 2.0". ``drivers.protocol.v2`` describes the format.
"""

from collections.abc import Iterable
from enum import IntEnum
from typing import Final

from fastcrc.crc16 import umts as crc16

from drivers.protocol.v2 import HEADER, STATUS, packet, unstuffed
from sim_backend.packets.instructions import Instruction, Parser

BROADCAST: Final = 0xFE
STATUS_OVERHEAD: Final = 11
"""Number of bytes in a status packet, excluding its data."""
_BLOCK_OVERHEAD: Final = 4
"""Number of bytes in a servo's block of a fast reply, excluding its data: error, ID and CRC."""
_HEAD: Final = 7
_SHORTEST: Final = 3
_LONGEST: Final = 1024
LONGEST_REPLY: Final = 0xFFFF
"""Maximum value of the length field."""


class Code(IntEnum):
    """Instructions of an X series servo."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    BACKUP = 0x20
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


def status_packet(servo_id: int, error: int, data: bytes = b"") -> bytes:
    """Return a servo's reply. ``error`` is defined as in ``drivers.protocol.v2``."""
    return packet(servo_id, STATUS, bytes((error,)) + data)


def fast_length(sizes: Iterable[int]) -> int:
    """Return the length field of a fast reply. The length covers the blocks of all servos, including silent servos."""
    return 1 + sum(size + _BLOCK_OVERHEAD for size in sizes)


def fast_head(length: int) -> bytes:
    """Return the beginning of a fast reply."""
    return HEADER + bytes((BROADCAST,)) + length.to_bytes(2, "little") + bytes((STATUS,))


def fast_block(before: bytes, servo_id: int, error: int, data: bytes) -> bytes:
    """Return the block that a servo adds to a fast reply after ``before``.

    The block is not byte-stuffed, and its CRC covers all bytes before it.
    """
    block = bytes((error, servo_id)) + data
    return block + crc16(before + block).to_bytes(2, "little")


def ends_whole(packet_so_far: bytes) -> bool:
    """Return whether the last two bytes are the CRC of the bytes before them."""
    return crc16(packet_so_far[:-2]) == int.from_bytes(packet_so_far[-2:], "little")


class InstructionParser(Parser):
    """Parser for instructions. The parser ignores the replies of other servos."""

    def _next_packet(self) -> Instruction | None:
        buffer = self._buffer
        while self._find_header():
            if len(buffer) < _HEAD:
                return None
            length = int.from_bytes(buffer[5:7], "little")
            end = length + _HEAD
            plausible = _SHORTEST <= length <= _LONGEST
            if plausible and len(buffer) < end:
                return None
            if plausible and crc16(bytes(buffer[: end - 2])) == int.from_bytes(buffer[end - 2 : end], "little"):
                body = unstuffed(bytes(buffer[_HEAD : end - 2]))
                instruction = Instruction(buffer[4], body[0], body[1:])
                del buffer[:end]
                if instruction.code != STATUS:
                    return instruction
                continue
            del buffer[0]
        return None

    def _find_header(self) -> bool:
        """Discard bytes that cannot begin a packet. Return whether the buffer still contains a complete header."""
        start = self._buffer.find(HEADER)
        del self._buffer[: start if start >= 0 else max(0, len(self._buffer) - len(HEADER) + 1)]
        return start >= 0
