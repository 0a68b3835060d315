"""A read plan is one question to several servos, and how their replies lie one behind the other."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import groupby
from struct import Struct

from drivers.bus.types import FaultKind, ServoFault, ServoState, fault
from drivers.protocol import v1, v2
from drivers.protocol.crc import crc16
from drivers.protocol.decoder import Reply
from drivers.servos.register import ByteOrder, Register
from drivers.servos.series import StateBlock, WireProtocol

ReadResult = ServoState | int | FaultKind | ServoFault
"""What became of one question to one servo: its state, or the register that was asked for, or why there is neither.
A fault in words of its own is a refusal: the servo says why."""

Whole = Callable[[bytes], Mapping[int, ServoState] | None]
"""All states where the bytes are exactly the replies of all servos in their order, and all is well; else None."""

Run = tuple[tuple[int, ...], StateBlock, tuple[float | None, ...]]
"""Servos asked for one block that answer one after the other: IDs, block, the scales of their models."""

_GOOD_SUM_V1 = (sum(v1.HEADER) + 0xFF) & 0xFF
"""Of a whole reply: its checksum makes the sum after the header 255."""


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
    fast: Run | None = None
    """What is asked of whom, where all answer with one packet."""

    def bytes_from(self, servo_ids: tuple[int, ...]) -> int:
        """Bytes of these servos' replies."""
        return sum(self.sizes[i] + self.overhead for i in servo_ids)


def state_plan(
    protocol: WireProtocol, blocks: Mapping[int, StateBlock], scales: Mapping[int, float | None]
) -> ReadPlan:
    """Ask each servo for its block."""
    servo_ids = tuple(blocks)
    runs: list[Run] = []
    for block, group in groupby(servo_ids, key=lambda i: blocks[i]):
        ids = tuple(group)
        runs.append((ids, block, tuple(scales[i] for i in ids)))
    whole = _whole_v1(runs, protocol) if protocol.packets is v1 else _whole_v2(runs)

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
        request = packets.read(*spans, *places.pop())
    else:
        request = packets.bulk_read(spans)
    return request


def fast_plan(block: StateBlock, scales: Mapping[int, float | None]) -> ReadPlan:
    """Ask all for the block by a fast sync read: they answer with one packet, in which each has its piece."""
    servo_ids = tuple(scales)
    run: Run = servo_ids, block, tuple(scales.values())
    return ReadPlan(
        servo_ids,
        dict.fromkeys(servo_ids, block.size),
        v2.fast_sync_read(servo_ids, block.address, block.size),
        v2.FAST_HEAD_SIZE + (block.size + v2.FAST_OVERHEAD) * len(servo_ids),
        v2.OVERHEAD,
        _whole_fast(run),
        lambda reply: "silent",
        dict.fromkeys(servo_ids, block),
        run,
    )


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


def _whole_v1(runs: list[Run], protocol: WireProtocol) -> Whole:
    """Each reply is unpacked by itself: a whole burst in one piece would be slower.

    This is the greater part of a cycle's Python. What it looks at has been forgotten by the processor since the last
    cycle, so few different steps done seven times are better than many done once.
    """
    replies = []
    begin = 0
    for servo_ids, block, scales in runs:
        numbers = block.fields.format
        unpack = Struct(f"{numbers[0]}IB{numbers[1:]}{block.size - block.fields.size}xB").unpack
        order: ByteOrder = "little" if numbers[0] == "<" else "big"
        for servo_id, scale in zip(servo_ids, scales, strict=True):
            head = int.from_bytes(v1.HEADER + bytes((servo_id, block.size + 2)), order)
            end = begin + block.size + v1.OVERHEAD
            replies.append((servo_id, slice(begin, end), unpack, head, scale, block.state))
            begin = end
    size, refusals = begin, protocol.refusals

    def whole(data: bytes) -> Mapping[int, ServoState] | None:
        if len(data) != size:
            return None
        states: dict[int, ServoState] = {}
        for servo_id, where, unpack, right_head, scale, state in replies:
            reply = data[where]
            head, status, position, velocity, load, voltage, temperature, _ = unpack(reply)
            if head != right_head or sum(reply) & 0xFF != _GOOD_SUM_V1 or status & refusals:
                return None
            states[servo_id] = state(scale, status, position, velocity, load, voltage, temperature)
        return states

    return whole


def _whole_v2(runs: list[Run]) -> Whole:
    parts = []
    begin = 0
    for run in runs:
        end = begin + (run[1].size + v2.OVERHEAD) * len(run[0])
        parts.append((slice(begin, end), _run_of_v2(*run)))
        begin = end
    if len(parts) == 1:
        return parts[0][1]

    def whole(data: bytes) -> Mapping[int, ServoState] | None:
        if len(data) != begin:
            return None
        states: dict[int, ServoState] = {}
        for where, part in parts:
            found = part(data[where])
            if found is None:
                return None
            states.update(found)
        return states

    return whole


def _run_of_v2(servo_ids: tuple[int, ...], block: StateBlock, scales: tuple[float | None, ...]) -> Whole:
    """The numbers of all replies are unpacked in one go: each head as one number, error byte, state, checksum."""
    size, count = block.size, len(servo_ids)
    skipped = block.at  # the state is at the block's end
    layout = Struct("<" + f"QB{skipped}x{block.fields.format[1:]}H" * count)
    step = len(layout.unpack(bytes(layout.size))) // count
    heads = tuple(
        int.from_bytes(v2.HEADER + bytes((i,)) + (size + 4).to_bytes(2, "little") + bytes((v2.STATUS,)), "little")
        for i in servo_ids
    )
    length = size + v2.OVERHEAD
    checks = [(slice(n * length, (n + 1) * length - 2), (n + 1) * step - 1) for n in range(count)]

    def whole(data: bytes) -> Mapping[int, ServoState] | None:
        if len(data) != layout.size or data.count(v2.PATTERN) != count:  # another length, or stuffed
            return None
        numbers = layout.unpack(data)
        errors = numbers[1::step]
        if numbers[::step] != heads or (any(errors) and any(error & ~v2.ALERT for error in errors)):
            return None
        for covered, check in checks:
            if crc16(data[covered]) != numbers[check]:
                return None
        return _proved(servo_ids, block, scales, errors, [numbers[column::step] for column in range(2, step - 1)])

    return whole


def _proved(
    servo_ids: tuple[int, ...],
    block: StateBlock,
    scales: tuple[float | None, ...],
    errors: tuple[int, ...],
    columns: list[tuple[int, ...]],
) -> Mapping[int, ServoState] | None:
    for place, value in block.proof:
        if columns[place].count(value) != len(servo_ids):
            return None
    return dict(zip(servo_ids, map(block.state, scales, errors, *columns), strict=True))


def _whole_fast(run: Run) -> Whole:
    """The last checksum goes over the whole packet: those of the pieces before need no look."""
    servo_ids, block, scales = run
    pieces = f"BB{block.at}x{block.fields.format[1:]}H" * len(servo_ids)
    layout = Struct(f"<{v2.FAST_HEAD_SIZE}x{pieces}")
    step = len(layout.unpack(bytes(layout.size))) // len(servo_ids)
    head = v2.fast_head(len(servo_ids), block.size)

    def whole(data: bytes) -> Mapping[int, ServoState] | None:
        if len(data) != layout.size or not data.startswith(head):
            return None
        numbers = layout.unpack(data)
        errors = numbers[::step]
        if numbers[1::step] != servo_ids or (any(errors) and any(error & ~v2.ALERT for error in errors)):
            return None
        if crc16(data[:-2]) != numbers[-1]:
            return None
        return _proved(servo_ids, block, scales, errors, [numbers[column::step] for column in range(2, step - 1)])

    return whole


def fast_results(run: Run, protocol: WireProtocol, data: bytes) -> dict[int, ReadResult]:
    """What a fast sync read's one reply says, up to the first servo that cannot be believed.

    Each servo's piece ends in a checksum of all that was sent before, so a piece is as sure as a packet.
    ``data`` begins with the reply's head. Nothing is stuffed in such a reply.
    """
    servo_ids, block, scales = run
    results: dict[int, ReadResult] = {}
    piece = block.size + v2.FAST_OVERHEAD
    if not data.startswith(v2.fast_head(len(servo_ids), block.size)):
        return results
    value, done = 0, 0
    for n, (servo_id, scale) in enumerate(zip(servo_ids, scales, strict=True)):
        at = v2.FAST_HEAD_SIZE + n * piece
        end = at + piece
        if len(data) < end or data[at + 1] != servo_id:
            break
        value = crc16(data[done : end - 2], value)
        if value != int.from_bytes(data[end - 2 : end], "little"):
            break
        done = end - 2
        results[servo_id] = _state_result(protocol, block, scale, Reply(servo_id, data[at], data[at + 2 : done]))
    return results
