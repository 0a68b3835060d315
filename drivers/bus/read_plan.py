"""A read plan is one question to several servos, and how their replies lie one behind the other."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from struct import Struct
from typing import Any
from zlib import adler32

from fastcrc.crc16 import umts as crc16

from drivers.bus.types import FaultKind, ServoFault, ServoState, fault
from drivers.protocol import v1, v2
from drivers.protocol.decoder import Reply
from drivers.servos.register import Register
from drivers.servos.series import StateBlock, WireProtocol

ReadResult = ServoState | int | FaultKind | ServoFault
"""What became of one question to one servo: its state, or the register that was asked for, or why there is neither.
A fault in words of its own is a refusal: the servo says why."""

Whole = Callable[[bytes], Mapping[int, ServoState] | None]
"""All states where the bytes are exactly the replies of all servos in their order, and all is well; else None."""

_GOOD_SUM_V1 = (1 + sum(v1.HEADER) + 0xFF) & 0xFF
"""Of a whole reply by Adler-32, which is 1 more than the sum: its checksum makes the sum after the header 255."""


@dataclass(frozen=True, slots=True)
class ReadPlan:
    """One question. ``sizes`` are the data of each servo's reply, in the order of the question."""

    servo_ids: tuple[int, ...]
    sizes: Mapping[int, int]
    request: bytes
    reply_size: int
    """Bytes of all replies, where nothing is stuffed."""
    overhead: int
    whole: Whole
    result: Callable[[Reply], ReadResult]
    """What one reply says by itself."""
    blocks: Mapping[int, StateBlock]
    fast: bool = False
    """Whether all answer with one packet, which is believed as a whole or not at all."""

    @property
    def exchange_size(self) -> int:
        """Bytes of the question and of all replies."""
        return len(self.request) + self.reply_size


def state_plan(
    protocol: WireProtocol, blocks: Mapping[int, StateBlock], scales: Mapping[int, float | None]
) -> ReadPlan:
    """Ask each servo for its block."""
    is_v1 = protocol.packets is v1
    whole = _whole_v1(protocol, blocks, scales) if is_v1 else _whole_v2(blocks, scales)

    def result(reply: Reply) -> ReadResult:
        return _state_result(protocol, blocks[reply.servo_id], scales[reply.servo_id], reply)

    spans = {i: (block.address, block.size) for i, block in blocks.items()}
    return _plan(protocol, spans, whole, result, blocks)


def register_plan(protocol: WireProtocol, registers: Mapping[int, Register]) -> ReadPlan:
    """Ask each servo for one register."""

    def result(reply: Reply) -> ReadResult:
        if refused := _refusal(protocol, reply):
            return refused
        return registers[reply.servo_id].decode(reply.data, protocol.byte_order)

    spans = {i: (register.address, register.size) for i, register in registers.items()}
    return _plan(protocol, spans, lambda data: None, result, {})


def _plan(
    protocol: WireProtocol,
    spans: Mapping[int, tuple[int, int]],
    whole: Whole,
    result: Callable[[Reply], ReadResult],
    blocks: Mapping[int, StateBlock],
) -> ReadPlan:
    overhead: int = protocol.packets.OVERHEAD
    sizes = {i: size for i, (_, size) in spans.items()}
    reply_size = sum(sizes.values()) + overhead * len(sizes)
    return ReadPlan(tuple(spans), sizes, _request(protocol, spans), reply_size, overhead, whole, result, blocks)


def _request(protocol: WireProtocol, spans: Mapping[int, tuple[int, int]]) -> bytes:
    """A sync read where the protocol has one and what is asked for lies alike in all servos, else a bulk read."""
    packets, places = protocol.packets, set(spans.values())
    if protocol.group_read == "sync" and len(places) == 1:
        request: bytes = packets.sync_read(tuple(spans), *places.pop())
    elif len(spans) == 1 and protocol.group_read != "sync":
        request = packets.packet(*spans, packets.READ, packets.span(*places.pop()))
    else:
        request = packets.bulk_read(spans)
    return request


def _refusal(protocol: WireProtocol, reply: Reply) -> ServoFault | None:
    """What a reply that says that there is no answer says of the reason."""
    if number := reply.error & protocol.refusals:
        return fault(reply.servo_id, "refused", f"it {protocol.refusal(number)}")
    return None


def _state_result(protocol: WireProtocol, block: StateBlock, scale: float | None, reply: Reply) -> ReadResult:
    if refused := _refusal(protocol, reply):
        # Nothing where the map's cells should be: it is another servo than the one that was mapped.
        no_map = block.proof and reply.error & protocol.refusals == v2.NO_ACCESS
        return "reset" if no_map else refused
    return block.decode(scale, reply.error, reply.data) or "reset"


@cache
def _unpack(layout: str) -> Callable[[bytes], tuple[Any, ...]]:
    """One function for all servos whose replies are alike: there is less to fetch into the processor's caches."""
    return Struct(layout).unpack


def _whole_v1(protocol: WireProtocol, blocks: Mapping[int, StateBlock], scales: Mapping[int, float | None]) -> Whole:
    """Each reply is unpacked by itself: a whole burst in one piece would be slower.

    This is the greater part of a cycle's Python. What it looks at has been forgotten by the processor since the last
    cycle, so few different steps done seven times are better than many done once. Every state of these protocols is
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

    def whole(data: bytes) -> Mapping[int, ServoState] | None:
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

    return whole


def _whole_v2(blocks: Mapping[int, StateBlock], scales: Mapping[int, float | None]) -> Whole:
    replies = []
    begin = 0
    for servo_id, block in blocks.items():
        # The head as one number, error byte, state (at the block's end), checksum.
        unpack = _unpack(f"<QB{block.at}x{block.fields.format[1:]}H")
        head = v2.HEADER + bytes((servo_id,)) + (block.size + 4).to_bytes(2, "little") + bytes((v2.STATUS,))
        end = begin + block.size + v2.OVERHEAD
        where, covered = slice(begin, end), slice(begin, end - 2)
        replies.append((servo_id, where, covered, unpack, int.from_bytes(head, "little"), scales[servo_id], block))
        begin = end
    size = begin

    def whole(data: bytes) -> Mapping[int, ServoState] | None:
        if len(data) != size or data.count(v2.PATTERN) != len(replies):  # another length, or stuffed
            return None
        states: dict[int, ServoState] = {}
        for servo_id, where, covered, unpack, right_head, scale, block in replies:
            head, error, *numbers, check = unpack(data[where])
            if head != right_head or error & ~v2.ALERT or crc16(data[covered]) != check or not block.proved(numbers):
                return None
            states[servo_id] = block.state(scale, error, *numbers)
        return states

    return whole
