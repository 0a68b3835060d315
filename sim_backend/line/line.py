"""Servos of any make on one half-duplex bus: timing, faults, and the order of replies.

No work is done in the background. When a packet is complete, the physics and firmware are advanced to its time, and
then the servo replies to the packet. A servo therefore reports its state at the end of the packet. Assumed:
- Two servos with the same ID drive the same wire, so their replies are combined by a bitwise AND.
- After a pause of 20 ms, a partially received packet is discarded.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar

from drivers.port.line import BITS_PER_BYTE
from sim_backend.line.rig import Rig, Stepped
from sim_backend.packets.faults import WireFaults
from sim_backend.packets.instructions import Instruction, Parser

PAUSE_S: Final = 0.02

Turn = tuple[float, list[bytes]]
"""Replies that are sent at the same time: the return delay (s) and the packets. Servos that share an ID send two
packets."""


class Wired(Stepped, Protocol):
    """The part of the servo interface that a bus uses."""

    @property
    def baud(self) -> int: ...

    @property
    def return_delay_s(self) -> float: ...

    @property
    def deaf(self) -> bool: ...

    def answer(self, instruction: Instruction) -> bytes | None: ...

    def power_cycle(self) -> None: ...


AnyServo = TypeVar("AnyServo", bound=Wired)


@dataclass(frozen=True, slots=True)
class DelayedReply:
    """Bytes that have fully arrived at the master at ``due_s``."""

    due_s: float
    data: bytes
    held_s: float = 0.0
    """Additional delay of the bytes in the adapter, in seconds; the wire is free during this delay."""


class ServoLine(ABC, Generic[AnyServo]):
    """A bus of servos. Times are on the caller's clock. The simulated time of the servos starts at the first call."""

    def __init__(self, rig: Rig[AnyServo], parser: Parser, id_at: int, *, paced: bool = True) -> None:
        """Create a line.

        If ``paced`` is true, bytes take time on the wire. If false, bytes take no time, which is useful for measuring
        software. ``id_at`` is the index of the servo ID within a reply.
        """
        self.rig = rig
        self.paced = paced
        self.faults = WireFaults()
        self.dropped_s = 0.0
        """Simulated time that was skipped because the caller was late, in seconds."""
        self.after_instructions: Callable[[], None] = _nothing
        """Function that is called after servos have executed an instruction, before the master gets the reply."""
        self._unplugged: set[AnyServo] = set()
        self._parser = parser
        self._id_at = id_at
        self._origin_s: float | None = None
        self._steps = 0
        self._heard_s = 0.0
        self._free_s = 0.0
        self._handed_over_s = 0.0

    @property
    def servos(self) -> tuple[AnyServo, ...]:
        """All servos, in the order of the plant's couplings."""
        return self.rig.servos

    def servo(self, servo_id: int) -> AnyServo:
        """Return the first servo with this ID."""
        return next(servo for servo in self.servos if servo.servo_id == servo_id)

    def unplug(self, servo: AnyServo) -> None:
        """Unplug the servo. The servo has no power and receives nothing until ``plug`` is called."""
        self._unplugged.add(servo)
        servo.power_cycle()

    def plugged(self, servo: AnyServo) -> bool:
        """Return whether the servo is plugged in."""
        return servo not in self._unplugged

    def plug(self, servo: AnyServo) -> None:
        """Plug the servo in, if it is not plugged in. The servo starts as after a power cycle."""
        if servo in self._unplugged:
            self._unplugged.remove(servo)
            servo.power_cycle()

    @property
    def reached_s(self) -> float:
        """Time that the physics and firmware have reached, on the caller's clock."""
        return (self._origin_s or 0.0) + self._steps * self.rig.timestep_s

    def advance(self, now_s: float, longest_s: float | None = None) -> None:
        """Advance the physics and firmware to ``now_s``.

        Time beyond ``longest_s`` is skipped and counted, so that catching up after a stall does not stall the computer
        again.
        """
        if self._origin_s is None:
            self._origin_s = now_s
        dt_s = self.rig.timestep_s
        # The small constant prevents a rounding error from losing a step.
        behind = int((now_s - self._origin_s) / dt_s + 1e-6) - self._steps
        if longest_s is not None and behind * dt_s > longest_s:
            excess = behind - int(longest_s / dt_s)
            self._origin_s += excess * dt_s
            self.dropped_s += excess * dt_s
            behind -= excess
        for _ in range(behind):
            self.rig.step()
        self._steps += max(0, behind)

    def receive(self, data: bytes, now_s: float, baud: int = 1_000_000) -> list[DelayedReply]:
        """Return the replies to ``data``, whose first byte the master sends at ``now_s``."""
        if baud == 0:  # In termios, a baud rate of 0 means a closed line.
            return []
        replies: list[DelayedReply] = []
        while self.faults.foreign:
            foreign = self.faults.foreign.popleft()
            answers = self._exchange(foreign, now_s, baud)
            replies += [DelayedReply(now_s, foreign), *answers]
        return self._through_adapter(replies + self._exchange(data, now_s, baud))

    def _exchange(self, data: bytes, now_s: float, baud: int) -> list[DelayedReply]:
        """Return the replies to bytes that a program sends. Each reply includes the time at which it has fully arrived
        at the master."""
        byte_s = BITS_PER_BYTE / baud if self.paced else 0.0
        begin_s = max(now_s, self._free_s)
        if now_s - self._heard_s > PAUSE_S:
            self._parser.reset()
        self._heard_s = now_s
        self._free_s = begin_s + len(data) * byte_s
        held = self.faults.take_held()
        replies: list[DelayedReply] = [DelayedReply(begin_s, held)] if held else []
        if self.faults.echo:
            replies.append(DelayedReply(self._free_s, data))
        for instruction in self._parser.feed(data):
            complete_s = begin_s + (len(data) - self._parser.pending) * byte_s
            self.advance(complete_s)
            replies += self._execute(instruction, complete_s, byte_s, self._listening(baud))
            self.after_instructions()
        replies += self._silence(self._free_s, byte_s)
        replies.sort(key=lambda reply: reply.due_s)
        if replies:
            self._free_s = max(self._free_s, replies[-1].due_s)
        return replies

    def _through_adapter(self, replies: list[DelayedReply]) -> list[DelayedReply]:
        """Delay the replies as the real adapter does. A delayed reply also delays all replies after it."""
        late = any(reply.held_s for reply in replies)
        if not replies or not (late or replies[0].due_s < self._handed_over_s):
            return replies
        through = []
        for reply in replies:
            self._handed_over_s = max(self._handed_over_s, reply.due_s + reply.held_s)
            through.append(DelayedReply(self._handed_over_s, reply.data))
        return through

    def _listening(self, baud: int) -> list[AnyServo]:
        """Return the servos that are connected and use this baud rate. All other servos receive noise or nothing."""
        faults = self.faults
        return [
            servo
            for servo in self.servos
            if servo not in self._unplugged
            and servo not in faults.mute
            and servo.baud == baud
            and not servo.deaf
            and faults.hears(servo.servo_id)
        ]

    @abstractmethod
    def _execute(
        self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[AnyServo]
    ) -> list[DelayedReply]:
        """Let ``servos`` execute one instruction, and return the replies in order."""

    def _silence(self, at_s: float, byte_s: float) -> list[DelayedReply]:
        """Return the replies that servos send only when the bus is idle. The master's bytes end at ``at_s``."""
        return []

    def _in_turn(self, turns: Iterable[Turn], at_s: float, byte_s: float, slot_s: float) -> list[DelayedReply]:
        """Return replies that are sent one after the other. If a servo does not reply in its turn, the next servo
        replies ``slot_s`` later."""
        replies = []
        for delay_s, packets in turns:
            if not packets:
                at_s += slot_s
                continue
            reply = self._reply(packets, at_s + (delay_s if self.paced else 0.0), byte_s)
            replies.append(reply)
            at_s = reply.due_s
        return replies

    def _chained(self, turns: Iterable[Turn], at_s: float, byte_s: float) -> list[DelayedReply]:
        """Return the replies of servos, each of which waits for the previous reply.

        The chain ends at the first servo that does not reply, and after a reply that is lost on the wire.
        """
        replies = []
        for delay_s, packets in turns:
            if not packets:
                break
            servo_id = packets[0][self._id_at]
            heard = self.faults.on_wire(servo_id, overlaid(packets))
            at_s += (delay_s if self.paced else 0.0) + max(map(len, packets)) * byte_s
            arrived = self.faults.through_adapter(servo_id, heard)
            replies.append(DelayedReply(at_s, arrived, self.faults.held_s(servo_id)))
            if not heard:
                break
        return replies

    def _reply(self, packets: Sequence[bytes], begin_s: float, byte_s: float) -> DelayedReply:
        """Return the bytes on the wire when these packets are sent at the same time."""
        servo_id = packets[0][self._id_at]
        data = self.faults.pass_reply(servo_id, overlaid(packets))
        return DelayedReply(begin_s + max(map(len, packets)) * byte_s, data, self.faults.held_s(servo_id))

    def _answers(self, instruction: Instruction, servos: Sequence[AnyServo]) -> list[Turn]:
        """Let all servos execute the instruction. Replies with the same ID are sent at the same time."""
        turns: dict[int, Turn] = {}
        for servo in sorted(servos, key=lambda servo: servo.servo_id):
            packet = servo.answer(instruction)
            if packet is not None:
                turns.setdefault(packet[self._id_at], (servo.return_delay_s, []))[1].append(packet)
        return list(turns.values())


def _nothing() -> None:
    pass


def named(servo_id: int, servos: Sequence[AnyServo]) -> list[AnyServo]:
    """Return the servos with this ID."""
    return [servo for servo in servos if servo.servo_id == servo_id]


def overlaid(packets: Sequence[bytes]) -> bytes:
    """Combine packets that are sent at the same time on a shared wire, which is at 1 when idle."""
    if len(packets) == 1:
        return packets[0]
    length = max(map(len, packets))
    merged = bytearray(b"\xff" * length)
    for packet in packets:
        for i, byte in enumerate(packet):
            merged[i] &= byte
    return bytes(merged)
