"""Servo side of the Feetech protocols and Dynamixel protocol 1.0: parse instructions and build status packets. No I/O.

Sources: Feetech's "FT-SCS protocol" manual; ROBOTIS e-manual, protocol 1.0. An instruction is
``FF FF id length code parameters checksum``, and a status packet is ``FF FF id length error data checksum``. The length
is the number of bytes after the length byte. The checksum is the inverted sum of all bytes between the header and the
checksum.
"""

from enum import IntEnum
from typing import Final

from sim_backend.packets.instructions import Instruction, Parser

HEADER: Final = b"\xff\xff"
BROADCAST: Final = 0xFE
STATUS_OVERHEAD: Final = 6
"""Number of bytes in a status packet, not counting its data."""
LONGEST_DATA: Final = 0xFF - 2
"""Maximum number of data bytes in a status packet."""


class Code(IntEnum):
    """Instructions. The series of a servo determines which of these instructions it supports."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    RESET = 0x06  # resets the EEPROM to factory values, except for the ID
    REBOOT = 0x08  # has no reply
    SAVE_DEFAULTS = 0x09  # STS: saves the current table as the values that RESET restores
    FORGET_TURNS = 0x0A  # STS
    SET_MIDDLE = 0x0B  # STS: sets the homing offset so that the current angle is reported as the given two-byte count
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    BULK_READ = 0x92


def checksum(body: bytes | bytearray) -> int:
    """Return the checksum of a packet's ``body``, which is everything after the header."""
    return ~sum(body) & 0xFF


def status_packet(servo_id: int, error: int, data: bytes = b"") -> bytes:
    """Return a servo's reply. ``error`` has the bits of ``drivers.servos.sts.STATUS_BITS``."""
    body = bytes((servo_id, len(data) + 2, error)) + data
    return HEADER + body + bytes((checksum(body),))


class InstructionParser(Parser):
    """Parser that searches rejected bytes for the next header, so that it finds a packet that follows an incomplete
    packet."""

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
        """Discard bytes that cannot begin a packet. Return whether the buffer still contains a whole header."""
        start = self._buffer.find(HEADER)
        if start < 0:
            start = len(self._buffer) - self._buffer.endswith(b"\xff")
        del self._buffer[:start]
        return len(self._buffer) >= len(HEADER)


class StsParser(Parser):
    """Parser of an STS servo. Two FF bytes start a new packet anywhere, even inside another packet.

    The parser has no time-out. An incomplete packet is kept until its remaining bytes or two FF bytes arrive.
    """

    LONGEST = 130
    """Maximum accepted length, except for a sync write. Packets with more than 128 parameters are ignored."""

    def __init__(self) -> None:
        super().__init__()
        self._body: bytearray | None = None
        self._last = 0

    def reset(self) -> None:
        """Do nothing, because a pause has no effect on these servos."""

    def _next_packet(self) -> Instruction | None:
        buffer = self._buffer
        end = self._whole_packet()
        if end:
            packet = Instruction(buffer[2], buffer[4], bytes(buffer[5 : end - 1]))
            self._last = buffer[end - 1]
            del buffer[:end]
            return packet
        for place, value in enumerate(buffer):
            taken = self._take(value)
            if taken is not None:
                del buffer[: place + 1]
                return taken
        buffer.clear()
        return None

    def _whole_packet(self) -> int:
        """Return the size of the valid packet at the start of the buffer, or 0 if there is none. Because of this check,
        the bytes of such a packet need not be processed one by one."""
        buffer = self._buffer
        if self._body is not None or self._last == 0xFF or len(buffer) < STATUS_OVERHEAD or buffer[:2] != HEADER:
            return 0
        end = buffer[3] + 4
        if not self._believed(buffer[3], buffer[4]) or len(buffer) < end or buffer.find(HEADER, 1, end) >= 0:
            return 0
        return end if checksum(buffer[2 : end - 1]) == buffer[end - 1] else 0

    def _take(self, value: int) -> Instruction | None:
        """Process one byte. Return the instruction that the byte completes, if the checksum is correct."""
        body, header = self._body, value == self._last == 0xFF
        self._last = value
        complete = body is not None and len(body) >= 2 and len(body) == body[1] + 1
        if header:
            self._body = bytearray()
        if body is None or (header and not complete):
            return None
        body.append(value)
        if complete:
            self._body = bytearray() if header else None  # An FF byte that was the checksum can begin the next header.
            return Instruction(body[0], body[2], bytes(body[3:-1])) if checksum(body[:-1]) == value else None
        if (len(body) == 2 and value < 2) or (len(body) == 3 and not self._believed(body[1], value)):
            self._body = None
        return None

    def _believed(self, length: int, code: int) -> bool:
        """Return whether a packet with this instruction may have this length."""
        return length >= 2 and (length <= self.LONGEST or code == Code.SYNC_WRITE)
