"""Fast sync reads: one packet in which each servo has its piece, so who is silent silences those behind.

Some firmware of the X series answers them. Nothing is stuffed in such a reply. Source: ROBOTIS e-manual, "Fast Sync
Read".
"""

import logging
from collections.abc import Mapping
from struct import Struct
from typing import Final

from drivers.bus.read_plan import ReadPlan, ReadResult, Whole, state_result
from drivers.bus.types import ServoState
from drivers.port.line import GAP_S, Line
from drivers.protocol import v2
from drivers.protocol.crc import crc16
from drivers.protocol.decoder import Reply
from drivers.servos.series import StateBlock, WireProtocol

LOG = logging.getLogger("servoloop.drivers")

FAST_TRIES: Final = 5
"""After so many broken answers in a row there are no more fast sync reads."""
FAST_TRIAL_S: Final = 0.005
"""How long the answer to the trial of a fast sync read may take beside its time on the wire."""


def fast_plan(protocol: WireProtocol, block: StateBlock, scales: Mapping[int, float | None]) -> ReadPlan:
    """Ask all servos for the block by one fast sync read."""
    servo_ids = tuple(scales)

    def pieces(data: bytes) -> dict[int, ReadResult]:
        return fast_results(protocol, block, scales, data)

    return ReadPlan(
        servo_ids,
        dict.fromkeys(servo_ids, block.size),
        v2.fast_sync_read(servo_ids, block.address, block.size),
        v2.FAST_HEAD_SIZE + (block.size + v2.FAST_OVERHEAD) * len(servo_ids),
        v2.OVERHEAD,
        _whole(block, scales),
        lambda reply: "silent",
        dict.fromkeys(servo_ids, block),
        pieces,
    )


def _whole(block: StateBlock, scales: Mapping[int, float | None]) -> Whole:
    """The last checksum goes over the whole packet: those of the pieces before need no look."""
    head = v2.fast_head(len(scales), block.size)
    piece = Struct(f"<BB{block.at}x{block.fields.format[1:]}H")
    size = len(head) + piece.size * len(scales)

    def whole(data: bytes) -> Mapping[int, ServoState] | None:
        if len(data) != size or not data.startswith(head) or crc16(data[:-2]) != int.from_bytes(data[-2:], "little"):
            return None
        states: dict[int, ServoState] = {}
        parts = piece.iter_unpack(data[len(head) :])
        for (servo_id, scale), (error, said_id, *numbers, _) in zip(scales.items(), parts, strict=True):
            if said_id != servo_id or error & ~v2.ALERT or not block.proved(numbers):
                return None
            states[servo_id] = block.state(scale, error, *numbers)
        return states

    return whole


def fast_results(
    protocol: WireProtocol, block: StateBlock, scales: Mapping[int, float | None], data: bytes
) -> dict[int, ReadResult]:
    """Decode a fast sync read's one reply, up to the first servo that cannot be believed.

    Each servo's piece ends in a checksum of all that was sent before, so a piece is as sure as a packet.
    ``data`` begins with the reply's head.
    """
    results: dict[int, ReadResult] = {}
    value, done, at = 0, 0, v2.FAST_HEAD_SIZE
    if not data.startswith(v2.fast_head(len(scales), block.size)):
        return results
    for servo_id, scale in scales.items():
        end = at + block.size + v2.FAST_OVERHEAD
        if len(data) < end or data[at + 1] != servo_id:
            break
        value = crc16(data[done : end - 2], value)
        if value != int.from_bytes(data[end - 2 : end], "little"):
            break
        done = end - 2
        results[servo_id] = state_result(protocol, block, scale, Reply(servo_id, data[at], data[at + 2 : done]))
        at = end
    return results


class FastReads:
    """Whether the servos of one line are asked fast: found out once, and given up where too much comes broken."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self.tried = False
        self.known = False
        """Whether the servos answer fast sync reads; ``trial`` finds out."""
        self._broken_in_a_row = 0

    def trial(self, plan: ReadPlan) -> None:
        """Ask servos that have just answered once more, fast, and remember whether they did.

        Not for a cycle: whoever does not know the instruction costs a wait. Nothing is counted. An adapter so
        slow that the answer does not come soon gets no fast reads: a silent first servo silences all, and
        would cost the slow adapter's whole wait in the cycle.
        """
        line = self._line
        self.tried = True
        due_s = line.ask(plan.request) + plan.reply_size * line.byte_s
        self.known = plan.whole(line.hear(plan.request, plan.reply_size, due_s + FAST_TRIAL_S)) is not None
        line.clean = False
        if not self.known:
            LOG.info("%s: not every servo knows fast sync reads: their states by plain ones", line.port.name)

    def came_whole(self) -> None:
        """A fast answer was complete."""
        self._broken_in_a_row = 0

    def judge(self, plan: ReadPlan, data: bytes, deadline_s: float) -> tuple[dict[int, ReadResult], int]:
        """Decode a packet that did not come as a whole: the results that can be believed, and the pieces of noise.

        The caller asks for the rest again; there are no more fast reads after too many broken ones.
        """
        results, noise = self._pieces(plan, data, deadline_s)
        broken = bool({"silent", "corrupt"} & {r for r in results.values() if isinstance(r, str)})
        self._broken_in_a_row = self._broken_in_a_row + 1 if broken else 0
        if self._broken_in_a_row == FAST_TRIES:
            self.known = False
            LOG.warning(
                "%s: %d fast sync reads broken in a row: plain ones from now on", self._line.port.name, FAST_TRIES
            )
        return results, noise

    def _pieces(self, plan: ReadPlan, data: bytes, deadline_s: float) -> tuple[dict[int, ReadResult], int]:
        assert plan.pieces is not None
        line, count, size = self._line, len(plan.servo_ids), plan.sizes[plan.servo_ids[0]]
        piece = size + v2.FAST_OVERHEAD
        begin = data.find(v2.fast_head(count, size))
        if begin > 0:  # behind noise, so as many bytes of it are still to come
            data += line.port.read(begin, min(line.now() + begin * line.byte_s + GAP_S, deadline_s))
        results = plan.pieces(data[begin:]) if begin >= 0 else {}
        garbage = len(data) - max(begin, 0) - len(results) * piece - v2.FAST_HEAD_SIZE
        for servo_id in plan.servo_ids[len(results) :]:
            corrupt = garbage > piece - piece // 2
            results[servo_id] = "corrupt" if corrupt else "silent"
            garbage -= piece if corrupt else 0
        return results, (begin > 0) + (garbage > 0)
