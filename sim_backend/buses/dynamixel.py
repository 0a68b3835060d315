"""Virtual Dynamixel servos on one bus. The servos convert timed instructions to timed replies.

According to the e-manual, ping is the only broadcast instruction that servos reply to; all servos reply in turn. The
servos reply to a sync read or a bulk read in the order in which the instruction lists them. The reply to a fast read is
a single packet to which each servo adds its block. According to the e-manual, the checksum of each block confirms the
"integrity between Dynamixels".

According to ROBOTIS (DynamixelSDK issues 331 and 364, observed with a logic analyzer), each servo waits until it has
received the reply of the servo listed before it. A silent servo therefore prevents all servos listed after it from
replying. Assumed: a reply with a wrong checksum is treated as received.

A servo also executes writes to its secondary ID, but sends no reply. Assumed: the servo ignores other instructions to
that ID, and a new protocol type takes effect immediately.

Assumptions for a fast read:
- A servo adds its block only after it has received the entire preceding block. The packet ends after a silent servo, or
  after a servo whose firmware does not support fast reads.
- The first servo waits for its return delay, and the other servos add their blocks immediately.
- No servo replies if the packet length does not fit into two bytes.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import reduce
from operator import and_
from typing import Final

from drivers.servos.register import ServoModel
from drivers.servos.xl320 import XL320
from sim_backend.line.line import DelayedReply, ServoLine, Turn, named
from sim_backend.line.rig import Rig, Supply
from sim_backend.mechanics.plant import Plant
from sim_backend.packets.dynamixel import (
    BROADCAST,
    LONGEST_REPLY,
    Code,
    InstructionParser,
    ends_whole,
    fast_head,
    fast_length,
)
from sim_backend.packets.dynamixel_groups import Entry, Span, bulk_entries, bulk_spans, sync_entries, sync_spans
from sim_backend.packets.instructions import Instruction
from sim_backend.servos.dynamixel.protocol2_servo import Protocol2Servo
from sim_backend.servos.dynamixel.servo import VirtualXServo
from sim_backend.servos.dynamixel.xl320_servo import VirtualXl320Servo

_ID_AT: Final = 4


class VirtualDynamixelBus(ServoLine[Protocol2Servo]):
    """A bus with X series and XL-320 servos.

    Times are on the caller's clock. The simulated time of the servos starts at the first call.
    """

    def __init__(self, rig: Rig[Protocol2Servo], *, paced: bool = True) -> None:
        """Create the line. If ``paced`` is true, transferring bytes takes time. If false, transfers take no time, which
        is useful for measuring software."""
        super().__init__(rig, InstructionParser(), _ID_AT, paced=paced)

    @classmethod
    def of(
        cls,
        plant: Plant,
        models: Mapping[int, ServoModel],
        *,
        supply: Supply | None = None,
        paced: bool = True,
        firmware: Mapping[int, int] | None = None,
    ) -> "VirtualDynamixelBus":
        """Create a bus with one servo for each coupling of ``plant``. ``models`` contains the model of each ID.

        The servos are set up for an arm: 1 Mbit/s and no return delay. If ``supply`` is None, servos with the same
        rated voltage share a supply, as in a 12 V arm with a converter for its 5 V servos. ``firmware`` contains the
        firmware versions, keyed by ID, that differ from the usual version.
        """
        ids = [coupling.servo_id for coupling in plant.couplings]
        servos = [_servo_of(models[i], i, (firmware or {}).get(i)) for i in ids]
        for servo in servos:
            servo.memory.put(servo.REGISTERS.baud_rate, servo.memory.BAUD_RATES.index(1_000_000))
            servo.memory.put(servo.REGISTERS.return_delay, 0)
        rated = {voltage_v: Supply(voltage_v) for voltage_v in {s.model.rated_voltage_v for s in servos}}
        return cls(Rig(servos, plant, supply or [rated[s.model.rated_voltage_v] for s in servos]), paced=paced)

    def _execute(
        self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[Protocol2Servo]
    ) -> list[DelayedReply]:
        parameters = instruction.parameters
        servos = [servo for servo in servos if servo.speaks]
        for servo in servos:
            servo.heard()
        match instruction.code:
            case Code.SYNC_WRITE:
                return _write(sync_entries(parameters), servos)
            case Code.BULK_WRITE:
                return _write(bulk_entries(parameters), servos)
            case Code.SYNC_READ:
                return self._chained(_reads(sync_spans(parameters), servos), at_s, byte_s)
            case Code.BULK_READ:
                return self._chained(_reads(bulk_spans(parameters), servos), at_s, byte_s)
            case Code.FAST_SYNC_READ:
                return self._fast(sync_spans(parameters), servos, at_s, byte_s)
            case Code.FAST_BULK_READ:
                return self._fast(bulk_spans(parameters), servos, at_s, byte_s)
        broadcast = instruction.servo_id == BROADCAST
        if instruction.code == Code.WRITE:
            _write_by_secondary_id(instruction.servo_id, _number(parameters[:2]), parameters[2:], servos)
        turns = self._answers(instruction, servos if broadcast else named(instruction.servo_id, servos))
        if broadcast and instruction.code != Code.PING:
            return []
        return self._in_turn(turns, at_s, byte_s, 0.0)

    def _fast(
        self, spans: Sequence[Span], servos: Sequence[Protocol2Servo], at_s: float, byte_s: float
    ) -> list[DelayedReply]:
        """Return one packet in blocks, up to the first servo that does not receive the previous block intact."""
        knowing = [servo for servo in servos if servo.answers_reads and servo.reads_fast]
        wire, replies = b"", list[DelayedReply]()
        length = fast_length(size for _, _, size in spans)
        if length > LONGEST_REPLY:
            return []
        for servo_id, address, size in spans:
            asked = named(servo_id, knowing)
            if not asked:
                break
            begun = wire or fast_head(length)
            block = _overlaid([servo.read_block(address, size, begun) for servo in asked])
            sent = block if wire else begun + block
            at_s += len(sent) * byte_s
            if not wire and self.paced:
                at_s += max(servo.return_delay_s for servo in asked)
            heard = self.faults.on_wire(servo_id, sent)
            arrived = self.faults.through_adapter(servo_id, heard)
            replies.append(DelayedReply(at_s, arrived, self.faults.held_s(servo_id)))
            wire += heard
            if not heard or not ends_whole(wire):
                break
        return replies


def _reads(spans: Iterable[Span], servos: Sequence[Protocol2Servo]) -> Iterator[Turn]:
    """Yield each servo's turn to reply to a sync read or a bulk read. A turn without a reply is the turn of a silent
    servo."""
    for servo_id, address, size in spans:
        asked = [servo for servo in named(servo_id, servos) if servo.answers_reads]
        delay_s = max((servo.return_delay_s for servo in asked), default=0.0)
        yield delay_s, [servo.read_status(address, size) for servo in asked]


def _servo_of(model: ServoModel, servo_id: int, firmware: int | None) -> Protocol2Servo:
    return VirtualXl320Servo(servo_id) if model == XL320 else VirtualXServo(model, servo_id, firmware)


def _overlaid(blocks: Sequence[bytes]) -> bytes:
    """Overlay blocks of equal length that servos with the same ID send at the same time."""
    if len(blocks) == 1:
        return blocks[0]
    return bytes(reduce(and_, column) for column in zip(*blocks, strict=True))


def _write(entries: Iterable[Entry], servos: Sequence[Protocol2Servo]) -> list[DelayedReply]:
    """Let each servo write its share of a group write. There is no reply."""
    for servo_id, address, data in entries:
        for servo in named(servo_id, servos):
            servo.write(address, data)
        _write_by_secondary_id(servo_id, address, data, servos)
    return []


def _write_by_secondary_id(servo_id: int, address: int, data: bytes, servos: Sequence[Protocol2Servo]) -> None:
    """Write to all servos that have this ID as their secondary ID but not as their primary ID."""
    for servo in servos:
        if servo.secondary_id == servo_id != servo.servo_id:
            servo.write_by_secondary_id(address, data)


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")
