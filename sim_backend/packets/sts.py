"""The servo's side of the Feetech protocols and of Dynamixel 1.0: instructions in, status packets out. Pure.

Source: Feetech's "FT-SCS protocol" manual; ROBOTIS e-manual, protocol 1.0. An instruction is
``FF FF id length code parameters checksum``, a status is ``FF FF id length error data checksum``;
length counts what follows it, the checksum is the inverted sum of everything between header and itself.
"""

from enum import IntEnum
from typing import Final

from sim_backend.packets.instructions import Instruction, Parser

HEADER: Final = b"\xff\xff"
BROADCAST: Final = 0xFE
STATUS_OVERHEAD: Final = 6
"""Bytes of a status packet beside its data."""
LONGEST_DATA: Final = 0xFF - 2
"""Maximum number of data bytes that a status packet's length can count."""


class Code(IntEnum):
    """Instructions; which a servo knows depends on its series."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    RESET = 0x06  # EEPROM back to factory values, the ID excepted
    REBOOT = 0x08  # never answered
    SAVE_DEFAULTS = 0x09  # STS: the present table is what RESET brings back
    FORGET_TURNS = 0x0A  # STS
    SET_MIDDLE = 0x0B  # STS: the present angle is what two bytes say
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


class StsParser(Parser):
    """What an STS servo makes of the stream: two FF bytes begin a packet wherever they are, even inside another.

    It has no time-out: a half packet lasts until the rest comes, or two FF bytes.
    """

    LONGEST = 130
    """Maximum length that is believed, except in a sync write: more than 128 parameters are not."""

    def __init__(self) -> None:
        super().__init__()
        self._body: bytearray | None = None
        self._last = 0

    def reset(self) -> None:
        """A pause changes nothing."""

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
        """The size of the sound packet with which the buffer begins, or 0: most need no look at each byte."""
        buffer = self._buffer
        if self._body is not None or self._last == 0xFF or len(buffer) < STATUS_OVERHEAD or buffer[:2] != HEADER:
            return 0
        end = buffer[3] + 4
        if not self._believed(buffer[3], buffer[4]) or len(buffer) < end or buffer.find(HEADER, 1, end) >= 0:
            return 0
        return end if checksum(buffer[2 : end - 1]) == buffer[end - 1] else 0

    def _take(self, value: int) -> Instruction | None:
        """One byte more; the instruction that it completes, if the checksum says so."""
        body, header = self._body, value == self._last == 0xFF
        self._last = value
        complete = body is not None and len(body) >= 2 and len(body) == body[1] + 1
        if header:
            self._body = bytearray()
        if body is None or (header and not complete):
            return None
        body.append(value)
        if complete:
            self._body = bytearray() if header else None  # an FF that was the checksum may begin the next header
            return Instruction(body[0], body[2], bytes(body[3:-1])) if checksum(body[:-1]) == value else None
        if (len(body) == 2 and value < 2) or (len(body) == 3 and not self._believed(body[1], value)):
            self._body = None
        return None

    def _believed(self, length: int, code: int) -> bool:
        """Whether a packet of this instruction may be so long."""
        return length >= 2 and (length <= self.LONGEST or code == Code.SYNC_WRITE)
