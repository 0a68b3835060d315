"""Fast sync reads: all servos reply with one common packet, so a silent servo also silences the servos after it.

Some firmware versions of the X series support fast sync reads, without byte stuffing. Source: ROBOTIS e-manual, "Fast
Sync Read".
"""

import logging
import math
from collections.abc import Mapping
from struct import Struct
from typing import Final

from fastcrc.crc16 import umts as crc16

from drivers.bus.late_replies import OPEN_S
from drivers.bus.read_plan import Decode, ReadPlan
from drivers.port.line import Line
from drivers.protocol import v2
from drivers.servos.series import StateBlock
from drivers.types import ServoState

LOG = logging.getLogger("servoloop.drivers")

FAST_TRIES: Final = 5
"""Number of consecutive failures after which fast sync reads are no longer used."""
FAST_TRIAL_S: Final = 0.005
"""Timeout of a trial fast sync read, in seconds, in addition to the transmission time."""

_EXECUTED: Final = frozenset((0, v2.ALERT))
"""Error bytes of a servo that has executed the instruction."""


def fast_plan(block: StateBlock, scales: Mapping[int, float | None]) -> ReadPlan:
    servo_ids = tuple(scales)
    return ReadPlan(
        servo_ids,
        dict.fromkeys(servo_ids, block.size),
        v2.fast_sync_read(servo_ids, block.address, block.size),
        v2.FAST_HEAD_SIZE + (block.size + v2.FAST_OVERHEAD) * len(servo_ids),
        v2.OVERHEAD,
        _decoder(block, scales),
        lambda reply: "silent",
        dict.fromkeys(servo_ids, block),
        fast=True,
    )


def replies_in(plan: ReadPlan, data: bytes) -> int:
    """Return the number of servos whose blocks a broken reply contains. The next servo is probably silent."""
    size = next(iter(plan.sizes.values())) + v2.FAST_OVERHEAD
    return max(0, len(data) - v2.FAST_HEAD_SIZE) // size


def _decoder(block: StateBlock, scales: Mapping[int, float | None]) -> Decode:
    """Return a decoder for the whole reply. Only the last checksum is checked, because it covers the whole packet.

    The decoder processes the fields of all servos together, because a loop over the servos takes twice as long.
    """
    servo_ids, units = tuple(scales), tuple(scales.values())
    head, state = v2.fast_head(len(servo_ids), block.size), block.state
    piece = f"BB{block.at}x{block.fields.format[1:]}H"  # error, ID, fields of the state, checksum
    unpack, width = Struct(f"<{piece * len(servo_ids)}").unpack_from, len(block.fields.unpack(bytes(block.fields.size)))
    size, step = len(head) + Struct(f"<{piece}").size * len(servo_ids), width + 3
    proof = block.proof and tuple((value,) * len(servo_ids) for value in block.proof)

    def decode_all(data: bytes) -> Mapping[int, ServoState] | None:
        if len(data) != size or not data.startswith(head) or crc16(data[:-2]) != int.from_bytes(data[-2:], "little"):
            return None
        numbers = unpack(data, len(head))
        errors, fields = numbers[::step], [numbers[at::step] for at in range(2, width + 2)]
        if numbers[1::step] != servo_ids or not _EXECUTED.issuperset(errors):
            return None
        if proof and (fields[0], fields[-1]) != proof:
            return None
        return dict(zip(servo_ids, map(state, units, errors, *fields), strict=True))

    return decode_all


class FastReads:
    """Choice between fast and plain sync reads on one bus.

    Fast sync reads are tried once, and are abandoned after too many failures.
    """

    def __init__(self, line: Line) -> None:
        self._line = line
        self.tried = False
        self.known = False
        """Whether all servos support fast sync reads, as determined by ``trial``."""
        self._failures_in_a_row = 0
        self._paused_until_s = -math.inf

    def trial(self, plan: ReadPlan) -> None:
        """Try a fast sync read of servos that have just replied, and record whether it succeeds.

        Call this outside a control cycle, because a servo that does not know the instruction causes a timeout. Faults
        are not counted. The trial fails on a slow adapter, because a silent first servo would delay each cycle too
        much.
        """
        line = self._line
        self.tried = True
        due_s = line.send_request(plan.request) + plan.reply_size * line.byte_s
        self.known = plan.decode_all(line.receive(plan.request, plan.reply_size, due_s + FAST_TRIAL_S)) is not None
        line.clean = False
        if not self.known:
            LOG.info("%s: using plain sync reads, because not every servo supports fast sync reads", line.port.name)

    def allowed(self) -> bool:
        """Return whether it is too late for any reply to a failed fast sync read to arrive."""
        return self._line.now() >= self._paused_until_s

    def succeeded(self) -> None:
        self._failures_in_a_row = 0

    def failed(self) -> None:
        """Record a failure. After it, plain sync reads are used for ``OPEN_S``, or permanently after ``FAST_TRIES``
        consecutive failures."""
        self._paused_until_s = self._line.now() + OPEN_S
        self._failures_in_a_row += 1
        if self._failures_in_a_row == FAST_TRIES:
            self.known = False
            name = self._line.port.name
            LOG.warning("%s: using plain sync reads, because %d consecutive fast sync reads failed", name, FAST_TRIES)
