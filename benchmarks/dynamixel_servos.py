"""X series servos without physics for ``benchmarks.simulator``, with indirect registers and group reads."""

from itertools import takewhile

from fastcrc.crc16 import umts as crc16

from drivers.protocol import v2 as wire

PING, READ, WRITE = 1, 2, 3
XL430 = 1060
POSITION_MODE = 3
CELLS, CELL_COUNT, POINTERS = 224, 28, 168
HEAD = 8
"""Number of bytes that precede the parameters in an instruction packet."""


def _table() -> bytearray:
    table = bytearray(1024)
    table[0:2] = XL430.to_bytes(2, "little")
    table[6], table[11], table[68] = 45, POSITION_MODE, 2
    table[48:52] = (4095).to_bytes(4, "little")  # max position limit
    table[124:126] = (20).to_bytes(2, "little")
    table[128:132] = (3).to_bytes(4, "little")
    table[132:136] = (2048).to_bytes(4, "little")
    table[144:146], table[146] = (120).to_bytes(2, "little"), 33
    for n in range(CELL_COUNT):
        table[POINTERS + 2 * n : POINTERS + 2 * n + 2] = (CELLS + n).to_bytes(2, "little")
    return table


class DynamixelServos:
    """All servos on one bus. Replies to group reads are cached until a register is written."""

    def __init__(self, servo_ids: list[int]) -> None:
        self.ids = servo_ids
        self.silent: set[int] = set()
        self._tables = {servo_id: _table() for servo_id in servo_ids}
        self._kept: dict[bytes, bytes] = {}

    @staticmethod
    def size(data: bytes) -> int:
        """Return the size of the packet at the start of ``data``, or 0 if its header is incomplete."""
        return int.from_bytes(data[5:7], "little") + 7 if len(data) >= HEAD else 0

    def silence(self, silent: set[int]) -> None:
        """From now on, make only these servos silent."""
        self.silent = silent
        self._kept.clear()

    def answer(self, packet: bytes) -> bytes:
        """Return all replies to one packet."""
        code = packet[7]
        if code == wire.SYNC_WRITE:
            return b""
        kept = self._kept.get(packet)
        if kept is None:
            kept = self._replies(packet[4], code, wire.unstuffed(packet[HEAD:-2]))
            if code == WRITE:
                self._kept.clear()
            else:
                self._kept[packet] = kept
        return kept

    def _replies(self, servo_id: int, code: int, parameters: bytes) -> bytes:
        address, size = (int.from_bytes(parameters[at : at + 2], "little") for at in (0, 2))
        if code in (wire.SYNC_READ, wire.FAST_SYNC_READ):
            asked = parameters[4:]
            # Each servo waits for the previous reply, so one silent servo keeps all later servos from replying.
            heard = list(takewhile(lambda i: i in self._tables and i not in self.silent, asked))
            if code == wire.FAST_SYNC_READ:
                return self._fast(heard, wire.fast_head(len(asked), size), address, size) if heard else b""
            return b"".join(self._reply(i, self._shown(i, address, size)) for i in heard)
        if servo_id not in self._tables or servo_id in self.silent:
            return b""
        if code == WRITE:
            self._tables[servo_id][address : address + len(parameters) - 2] = parameters[2:]
            return self._reply(servo_id, b"")
        content = self._shown(servo_id, address, size) if code == READ else self._tables[servo_id][0:2] + b"\x2d"
        return self._reply(servo_id, bytes(content))

    def _reply(self, servo_id: int, content: bytes) -> bytes:
        return wire.packet(servo_id, wire.STATUS, b"\0" + content)

    def _fast(self, servo_ids: list[int], head: bytes, address: int, size: int) -> bytes:
        reply = head
        for servo_id in servo_ids:
            reply += bytes((0, servo_id)) + self._shown(servo_id, address, size)
            reply += crc16(reply).to_bytes(2, "little")
        return reply

    def _shown(self, servo_id: int, address: int, size: int) -> bytes:
        """Return the registers as a client reads them. An indirect data address returns the byte that its pointer
        selects."""
        table = self._tables[servo_id]
        return bytes(table[self._place(table, at)] for at in range(address, address + size))

    @staticmethod
    def _place(table: bytearray, at: int) -> int:
        if not CELLS <= at < CELLS + CELL_COUNT:
            return at
        pointer = POINTERS + 2 * (at - CELLS)
        return int.from_bytes(table[pointer : pointer + 2], "little")
