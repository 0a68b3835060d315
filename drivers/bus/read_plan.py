"""Plan one request to several servos and the layout of their replies."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from struct import Struct
from typing import Any, NamedTuple
from zlib import adler32

from fastcrc.crc16 import umts as crc16

from drivers.protocol import v1, v2
from drivers.protocol.decoder import Reply
from drivers.servos.register import Register
from drivers.servos.series import StateBlock, WireProtocol
from drivers.types import FaultKind, ServoFault, ServoState, fault

ReadResult = ServoState | int | FaultKind | ServoFault
"""Result of one request to one servo: a state, a register value, or a fault. A ``ServoFault`` is a rejection with a
reason.
"""

Decode = Callable[[bytes], Mapping[int, ServoState] | None]
"""Function that returns all states if the bytes are exactly the valid replies of all servos in order, and otherwise
None.
"""

_GOOD_SUM_V1 = (1 + sum(v1.HEADER) + 0xFF) & 0xFF
"""Low byte of Adler-32 over a valid reply. The checksum makes the bytes after the header sum to 255, and Adler-32 adds
1.
"""


@dataclass(frozen=True, slots=True)
class ReadPlan:
    """One request to several servos. ``sizes`` holds the data size of each reply, in the order of the request."""

    servo_ids: tuple[int, ...]
    sizes: Mapping[int, int]
    request: bytes
    reply_size: int
    """Number of bytes of all replies without byte stuffing."""
    overhead: int
    decode_all: Decode
    result: Callable[[Reply], ReadResult]
    """Function that decodes a single reply."""
    blocks: Mapping[int, StateBlock]
    fast: bool = False
    """Whether all servos reply with one common packet, which is valid only as a whole."""

    @property
    def exchange_size(self) -> int:
        return len(self.request) + self.reply_size


def state_plan(
    protocol: WireProtocol,
    blocks: Mapping[int, StateBlock],
    scales: Mapping[int, float | None],
    *,
    separate: bool = False,
) -> ReadPlan:
    """Plan a read of states. ``separate`` selects a plain read instead of a group read if there is only one servo."""
    is_v1 = protocol.packets is v1
    decode_all = _decoder_v1(protocol, blocks, scales) if is_v1 else _decoder_v2(blocks, scales)

    def result(reply: Reply) -> ReadResult:
        return _state_result(protocol, blocks[reply.servo_id], scales[reply.servo_id], reply)

    spans = {i: (block.address, block.size) for i, block in blocks.items()}
    return _plan(_Request(protocol, spans, separate), decode_all, result, blocks)


def register_plan(protocol: WireProtocol, registers: Mapping[int, Register], *, separate: bool = False) -> ReadPlan:
    """Plan a read of one register of each servo. ``separate`` selects a plain read if there is only one servo."""

    def result(reply: Reply) -> ReadResult:
        if refused := _refusal(protocol, reply):
            return refused
        return registers[reply.servo_id].decode(reply.data, protocol.byte_order)

    spans = {i: (register.address, register.size) for i, register in registers.items()}
    return _plan(_Request(protocol, spans, separate), lambda data: None, result, {})


class _Request(NamedTuple):
    """A request for data from some servos."""

    protocol: WireProtocol
    spans: Mapping[int, tuple[int, int]]
    """Address and size of the data, keyed by ID."""
    separate: bool

    def encode(self) -> bytes:
        """Encode a sync read if the protocol supports it and all spans are equal, otherwise a bulk read."""
        packets, spans, places = self.protocol.packets, self.spans, set(self.spans.values())
        in_groups = self.protocol.group_read == "sync" and not self.separate
        if in_groups and len(places) == 1:
            request: bytes = packets.sync_read(tuple(spans), *places.pop())
        elif len(spans) == 1 and not in_groups:
            request = packets.packet(*spans, packets.READ, packets.span(*places.pop()))
        else:
            request = packets.bulk_read(spans)
        return request


def _plan(
    request: _Request,
    decode_all: Decode,
    result: Callable[[Reply], ReadResult],
    blocks: Mapping[int, StateBlock],
) -> ReadPlan:
    overhead: int = request.protocol.packets.OVERHEAD
    sizes = {i: size for i, (_, size) in request.spans.items()}
    reply_size = sum(sizes.values()) + overhead * len(sizes)
    return ReadPlan(tuple(sizes), sizes, request.encode(), reply_size, overhead, decode_all, result, blocks)


def _refusal(protocol: WireProtocol, reply: Reply) -> ServoFault | None:
    if number := reply.error & protocol.refusals:
        return fault(reply.servo_id, "refused", f"it {protocol.refusal(number)}")
    return None


def _state_result(protocol: WireProtocol, block: StateBlock, scale: float | None, reply: Reply) -> ReadResult:
    if refused := _refusal(protocol, reply):
        # The mapped registers do not exist, so this is not the servo that was mapped.
        no_map = block.proof and reply.error & protocol.refusals == v2.NO_ACCESS
        return "reset" if no_map else refused
    return block.decode(scale, reply.error, reply.data) or "reset"


@cache
def _unpack(layout: str) -> Callable[[bytes], tuple[Any, ...]]:
    """Return one shared function for each layout, which saves space in the processor caches."""
    return Struct(layout).unpack


def _decoder_v1(protocol: WireProtocol, blocks: Mapping[int, StateBlock], scales: Mapping[int, float | None]) -> Decode:
    """Return a decoder that unpacks each reply separately. This is faster than unpacking all replies together.

    A control cycle spends most of its Python time in this decoder, with cold processor caches. Repeating a few
    steps for seven servos is therefore faster than executing many steps once. In these protocols, a state consists of
    five numbers.
    """
    replies = []
    begin = 0
    for servo_id, block in blocks.items():
        numbers = block.fields.format
        unpack = _unpack(f"{numbers[0]}IB{numbers[1:]}{block.size - block.fields.size}xB")
        head = int.from_bytes(v1.HEADER + bytes((servo_id, block.size + 2)), protocol.byte_order)
        end = begin + block.size + v1.OVERHEAD
        replies.append((servo_id, slice(begin, end), unpack, head, scales[servo_id], block.state))
        begin = end
    size, refusals = begin, protocol.refusals

    def decode_all(data: bytes) -> Mapping[int, ServoState] | None:
        if len(data) != size:
            return None
        states: dict[int, ServoState] = {}
        for servo_id, where, unpack, right_head, scale, state in replies:
            reply = data[where]
            head, status, position, velocity, load, voltage, temperature, _ = unpack(reply)
            if head != right_head or adler32(reply) & 0xFF != _GOOD_SUM_V1 or status & refusals:
                return None
            states[servo_id] = state(scale, status, position, velocity, load, voltage, temperature)
        return states

    return decode_all


def _decoder_v2(blocks: Mapping[int, StateBlock], scales: Mapping[int, float | None]) -> Decode:
    replies = []
    begin = 0
    for servo_id, block in blocks.items():
        # The layout is: head as one number, error byte, state (at the end of the block), and checksum.
        unpack = _unpack(f"<QB{block.at}x{block.fields.format[1:]}H")
        head = v2.HEADER + bytes((servo_id,)) + (block.size + 4).to_bytes(2, "little") + bytes((v2.STATUS,))
        end = begin + block.size + v2.OVERHEAD
        where, covered = slice(begin, end), slice(begin, end - 2)
        replies.append((servo_id, where, covered, unpack, int.from_bytes(head, "little"), scales[servo_id], block))
        begin = end
    size = begin

    def decode_all(data: bytes) -> Mapping[int, ServoState] | None:
        if len(data) != size or data.count(v2.PATTERN) != len(replies):  # wrong length, or stuffed bytes
            return None
        states: dict[int, ServoState] = {}
        for servo_id, where, covered, unpack, right_head, scale, block in replies:
            head, error, *numbers, check = unpack(data[where])
            if head != right_head or error & ~v2.ALERT or crc16(data[covered]) != check or not block.proved(numbers):
                return None
            states[servo_id] = block.state(scale, error, *numbers)
        return states

    return decode_all
