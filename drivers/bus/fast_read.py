"""Fast sync reads: one packet in which each servo has its piece, so who is silent silences those behind.

Some firmware of the X series answers them, with nothing stuffed. Source: ROBOTIS e-manual, "Fast Sync Read".
"""

import logging
import math
from collections.abc import Mapping
from struct import Struct
from typing import Final

from fastcrc.crc16 import umts as crc16

from drivers.bus.late_replies import OPEN_S
from drivers.bus.read_plan import ReadPlan, Whole
from drivers.bus.types import ServoState
from drivers.port.line import Line
from drivers.protocol import v2
from drivers.servos.series import StateBlock

LOG = logging.getLogger("servoloop.drivers")

FAST_TRIES: Final = 5
"""After so many broken answers in a row there are no more fast sync reads."""
FAST_TRIAL_S: Final = 0.005
"""How long the answer to the trial of a fast sync read may take beside its time on the wire."""


def fast_plan(block: StateBlock, scales: Mapping[int, float | None]) -> ReadPlan:
    """Ask all servos for the block by one fast sync read."""
    servo_ids = tuple(scales)
    return ReadPlan(
        servo_ids,
        dict.fromkeys(servo_ids, block.size),
        v2.fast_sync_read(servo_ids, block.address, block.size),
        v2.FAST_HEAD_SIZE + (block.size + v2.FAST_OVERHEAD) * len(servo_ids),
        v2.OVERHEAD,
        _whole(block, scales),
        lambda reply: "silent",
        dict.fromkeys(servo_ids, block),
        fast=True,
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


class FastReads:
    """Whether the servos of one line are asked fast: found out once, and given up where too much comes broken."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self.tried = False
        self.known = False
        """Whether the servos answer fast sync reads; ``trial`` finds out."""
        self._broken_in_a_row = 0
        self._rests_until_s = -math.inf

    def trial(self, plan: ReadPlan) -> None:
        """Ask servos that have just answered once more, fast, and remember whether they did.

        Not for a cycle: whoever does not know the instruction costs a wait. Nothing is counted. A slow adapter gets no
        fast reads: a silent first servo silences all, and would cost its whole wait in the cycle.
        """
        line = self._line
        self.tried = True
        due_s = line.ask(plan.request) + plan.reply_size * line.byte_s
        self.known = plan.whole(line.hear(plan.request, plan.reply_size, due_s + FAST_TRIAL_S)) is not None
        line.clean = False
        if not self.known:
            LOG.info("%s: not every servo knows fast sync reads: their states by plain ones", line.port.name)

    def may_be_asked(self) -> bool:
        """Whether no answer to a broken one can still come."""
        return self._line.now() >= self._rests_until_s

    def came_whole(self) -> None:
        """A fast answer was complete."""
        self._broken_in_a_row = 0

    def came_broken(self) -> None:
        """Something was missing or wrong: the next are plain, and after too many in a row all."""
        self._rests_until_s = self._line.now() + OPEN_S
        self._broken_in_a_row += 1
        if self._broken_in_a_row == FAST_TRIES:
            self.known = False
            name = self._line.port.name
            LOG.warning("%s: %d fast sync reads broken in a row: plain ones from now on", name, FAST_TRIES)
