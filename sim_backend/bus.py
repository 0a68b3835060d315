"""Virtual servos on one half-duplex wire: bytes and a time in, bytes and their arrival out.

Nothing here runs by itself. Physics and firmware are brought up to the moment at which a packet is
complete, and only then is it answered: what a servo reports is what it would see at that moment.

From the protocol manual: no reply to a broadcast; a sync read is answered in the order in which
it names the servos. Assumed: the turns of a sync read are slots, so a silent servo leaves a gap as
long as its reply would have been, and those after it answer all the same; a broadcast ping, which
the manual advises against, is answered one after the other by rising ID (clients in use rely on
that); two servos with one ID pull the same line, so their replies come out and-ed; a pause of 20 ms
ends a half-received packet.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from drivers.feetech import sts
from drivers.registers import ServoModel
from sim_backend.faults import WireFaults
from sim_backend.plant import Plant
from sim_backend.rig import Rig, Supply
from sim_backend.servo import VirtualServo
from sim_backend.sts_wire import BROADCAST, STATUS_OVERHEAD, Code, Instruction, InstructionParser

BITS_PER_BYTE: Final = 10
PAUSE_S: Final = 0.02

Turn = tuple[float, list[bytes]]
"""Who replies at one time: the return delay (s), and the packets; two of them if two share an ID."""


@dataclass(frozen=True, slots=True)
class Reply:
    """Bytes that have all arrived at the master when the clock says ``due_s``."""

    due_s: float
    data: bytes


class VirtualBus:
    """A line of servos. Times are the caller's clock; the rig's time begins with the first call."""

    def __init__(self, rig: Rig, *, paced: bool = True) -> None:
        """``paced`` bytes take their time on the wire; unpaced ones none (to measure software)."""
        self.rig = rig
        self.paced = paced
        self.faults = WireFaults()
        self.dropped_s = 0.0
        """Physical time that was skipped because the caller came too late."""
        self._parser = InstructionParser()
        self._origin_s: float | None = None
        self._steps = 0
        self._heard_s = 0.0
        self._free_s = 0.0

    @classmethod
    def of(
        cls,
        plant: Plant,
        model: ServoModel = sts.STS3215,
        *,
        supply: Supply | None = None,
        paced: bool = True,
    ) -> "VirtualBus":
        """A bus with one new servo of ``model`` for each coupling of ``plant``."""
        servos = [VirtualServo(model, coupling.servo_id) for coupling in plant.couplings]
        return cls(Rig(servos, plant, supply), paced=paced)

    @property
    def servos(self) -> tuple[VirtualServo, ...]:
        """All servos in the order of the plant's couplings."""
        return self.rig.servos

    def servo(self, servo_id: int) -> VirtualServo:
        """The first servo with this ID."""
        return next(servo for servo in self.servos if servo.servo_id == servo_id)

    def advance(self, now_s: float, longest_s: float | None = None) -> None:
        """Bring physics and firmware up to ``now_s``.

        Beyond ``longest_s`` the time is dropped and counted: a stalled machine must not stall again
        by catching up.
        """
        if self._origin_s is None:
            self._origin_s = now_s
        dt_s = self.rig.timestep_s
        # The small part keeps a rounding error from costing a step.
        behind = int((now_s - self._origin_s) / dt_s + 1e-6) - self._steps
        if longest_s is not None and behind * dt_s > longest_s:
            excess = behind - int(longest_s / dt_s)
            self._origin_s += excess * dt_s
            self.dropped_s += excess * dt_s
            behind -= excess
        for _ in range(behind):
            self.rig.step()
        self._steps += max(0, behind)

    def receive(self, data: bytes, now_s: float, baud: int = 1_000_000) -> list[Reply]:
        """What the servos answer to ``data``, whose first byte the master sends at ``now_s``."""
        byte_s = BITS_PER_BYTE / baud if self.paced else 0.0
        begin_s = max(now_s, self._free_s)
        if now_s - self._heard_s > PAUSE_S:
            self._parser.reset()
        self._heard_s = now_s
        self._free_s = begin_s + len(data) * byte_s
        replies: list[Reply] = []
        for instruction in self._parser.feed(data):
            complete_s = begin_s + (len(data) - self._parser.pending) * byte_s
            self.advance(complete_s)
            replies += self._obey(instruction, complete_s, byte_s, self._listening(baud))
        if replies:
            self._free_s = max(self._free_s, replies[-1].due_s)
        return replies

    def _listening(self, baud: int) -> list[VirtualServo]:
        """Servos that understand this baud and are there. The others hear garbage, or nothing."""
        faults = self.faults
        return [
            servo
            for servo in self.servos
            if servo.baud == baud and not servo.deaf and not faults.is_silent(servo.servo_id)
        ]

    def _obey(
        self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[VirtualServo]
    ) -> list[Reply]:
        """Let ``servos`` do one instruction; whatever comes back, in order."""
        parameters = instruction.parameters
        if instruction.code == Code.SYNC_WRITE:
            _sync_write(parameters, servos)
            return []
        if instruction.code == Code.SYNC_READ:
            slot_s = (STATUS_OVERHEAD + sum(parameters[1:2])) * byte_s
            return self._in_turn(_sync_read(parameters, servos), at_s, byte_s, slot_s)
        broadcast = instruction.servo_id == BROADCAST
        turns = _answers(instruction, servos if broadcast else _named(instruction.servo_id, servos))
        if broadcast and instruction.code != Code.PING:
            return []
        return self._in_turn(turns, at_s, byte_s, 0.0)

    def _in_turn(self, turns: Iterable[Turn], at_s: float, byte_s: float, slot_s: float) -> list[Reply]:
        """Replies one after the other; a turn without a reply lasts ``slot_s``."""
        replies = []
        for delay_s, packets in turns:
            if not packets:
                at_s += slot_s
                continue
            at_s += max(map(len, packets)) * byte_s + (delay_s if self.paced else 0.0)
            data = self.faults.pass_reply(packets[0][2], _overlaid(packets))
            replies.append(Reply(at_s, data))
        return replies


def _named(servo_id: int, servos: Sequence[VirtualServo]) -> list[VirtualServo]:
    return [servo for servo in servos if servo.servo_id == servo_id]


def _answers(instruction: Instruction, servos: Sequence[VirtualServo]) -> list[Turn]:
    """All do the instruction; answers with the same ID in them come at the same time."""
    turns: dict[int, Turn] = {}
    for servo in sorted(servos, key=lambda servo: servo.servo_id):
        packet = servo.answer(instruction)
        if packet is not None:
            turns.setdefault(packet[2], (servo.return_delay_s, []))[1].append(packet)
    return list(turns.values())


def _sync_read(parameters: bytes, servos: Sequence[VirtualServo]) -> list[Turn]:
    """Address, size, and then the IDs: a turn for each of them, whether anybody is there or not."""
    turns = []
    for servo_id in parameters[2:]:
        asked = _named(servo_id, servos)
        delay_s = max((servo.return_delay_s for servo in asked), default=0.0)
        turns.append((delay_s, [servo.read_status(*parameters[:2]) for servo in asked]))
    return turns


def _overlaid(packets: Sequence[bytes]) -> bytes:
    """Packets sent at once on one line whose idle level is 1."""
    length = max(map(len, packets))
    merged = bytearray(b"\xff" * length)
    for packet in packets:
        for i, byte in enumerate(packet):
            merged[i] &= byte
    return bytes(merged)


def _sync_write(parameters: bytes, servos: Sequence[VirtualServo]) -> None:
    """Address, size, and then an ID and ``size`` bytes for each servo; half an entry is ignored."""
    if len(parameters) < 2:
        return
    address, size = parameters[:2]
    for at in range(2, len(parameters) - size, size + 1):
        for servo in _named(parameters[at], servos):
            servo.write(address, parameters[at + 1 : at + 1 + size])
