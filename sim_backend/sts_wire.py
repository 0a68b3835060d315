"""The servo's side of the Feetech protocols and of Dynamixel 1.0: instructions in, status packets out. Pure.

Source: Feetech's "FT-SCS protocol" manual; ROBOTIS e-manual, protocol 1.0. An instruction is
``FF FF id length code parameters checksum``, a status is ``FF FF id length error data checksum``;
length counts what follows it, the checksum is the inverted sum of everything between header and itself.
"""

from enum import IntEnum
from typing import Final

from sim_backend.instructions import Instruction, Parser

HEADER: Final = b"\xff\xff"
BROADCAST: Final = 0xFE
STATUS_OVERHEAD: Final = 6
"""Bytes of a status packet beside its data."""


class Code(IntEnum):
    """Instructions; which a servo knows depends on its series."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    RESET = 0x06  # EEPROM back to factory values, the ID excepted
    REBOOT = 0x08  # never answered
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    BULK_READ = 0x92


def checksum(body: bytes | bytearray) -> int:
    """The checksum of a packet's ``body``, which is everything after the header."""
    return ~sum(body) & 0xFF


def status_packet(servo_id: int, error: int, data: bytes = b"") -> bytes:
    """A servo's reply; ``error`` has the bits of ``drivers.servos.sts.STATUS_BITS``."""
    body = bytes((servo_id, len(data) + 2, error)) + data
    return HEADER + body + bytes((checksum(body),))


class InstructionParser(Parser):
    """The search for the next header goes on within rejected bytes: a packet behind a half packet is still found."""

    def _next_packet(self) -> Instruction | None:
        buffer = self._buffer
        while self._find_header():
            if len(buffer) < 4:
                return None
            end = buffer[3] + 4
            plausible = buffer[2] != 0xFF and buffer[3] >= 2
            if plausible and len(buffer) < end:
                return None
            if plausible and checksum(buffer[2 : end - 1]) == buffer[end - 1]:
                packet = Instruction(buffer[2], buffer[4], bytes(buffer[5 : end - 1]))
                del buffer[:end]
                return packet
            del buffer[0]
        return None

    def _find_header(self) -> bool:
        """Drop what cannot begin a packet; whether a whole header is left."""
        start = self._buffer.find(HEADER)
        if start < 0:
            start = len(self._buffer) - self._buffer.endswith(b"\xff")
        del self._buffer[:start]
        return len(self._buffer) >= len(HEADER)
