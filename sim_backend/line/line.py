"""Servos on one half-duplex wire, whatever their make: time, pace, faults, turns.

Nothing here runs by itself. Physics and firmware are brought up to the moment at which a packet is
complete, and only then is it answered: what a servo reports is what it would see at that moment.
Two servos with one ID pull the same line, so their replies come out and-ed; a pause of 20 ms ends a
half-received packet (both assumed).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar

from sim_backend.line.rig import Rig, Stepped
from sim_backend.packets.faults import WireFaults
from sim_backend.packets.instructions import Instruction, Parser

BITS_PER_BYTE: Final = 10
PAUSE_S: Final = 0.02

Turn = tuple[float, list[bytes]]
"""Who replies at one time: the return delay (s), and the packets; two of them if two share an ID."""


class Wired(Stepped, Protocol):
    """What a line needs of a servo."""

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
class Reply:
    """Bytes that have all arrived at the master when the clock says ``due_s``."""

    due_s: float
    data: bytes
    held_s: float = 0.0
    """For so much longer the adapter keeps them, while the wire is free."""


class ServoLine(ABC, Generic[AnyServo]):
    """A line of servos. Times are the caller's clock; the rig's time begins with the first call."""

    def __init__(self, rig: Rig[AnyServo], parser: Parser, id_at: int, *, paced: bool = True) -> None:
        """``paced`` bytes take their time on the wire; unpaced ones none (to measure software).

        ``id_at`` is where a reply has its servo's ID.
        """
        self.rig = rig
        self.paced = paced
        self.faults = WireFaults()
        self.dropped_s = 0.0
        """Physical time that was skipped because the caller came too late."""
        self.after_instructions: Callable[[], None] = _nothing
        """Called after servos have done what they were told, before anybody hears of it."""
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
        """All servos in the order of the plant's couplings."""
        return self.rig.servos

    def servo(self, servo_id: int) -> AnyServo:
        """The first servo with this ID."""
        return next(servo for servo in self.servos if servo.servo_id == servo_id)

    def unplug(self, servo: AnyServo) -> None:
        """Pull the servo's plug: it has no power and hears nothing until ``plug``."""
        self._unplugged.add(servo)
        servo.power_cycle()

    def plugged(self, servo: AnyServo) -> bool:
        """Whether the servo's plug is in."""
        return servo not in self._unplugged

    def plug(self, servo: AnyServo) -> None:
        """Plug the servo in, if it is not: it comes up as after any power-off."""
        if servo in self._unplugged:
            self._unplugged.remove(servo)
            servo.power_cycle()

    @property
    def reached_s(self) -> float:
        """The moment, on the caller's clock, up to which physics and firmware are brought."""
        return (self._origin_s or 0.0) + self._steps * self.rig.timestep_s

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
        if baud == 0:  # hung up, as termios has it: nothing goes over the line
            return []
        replies: list[Reply] = []
        while self.faults.foreign:
            foreign = self.faults.foreign.popleft()
            answers = self._exchange(foreign, now_s, baud)
            replies += [Reply(now_s, foreign), *answers]
        return self._through_adapter(replies + self._exchange(data, now_s, baud))

    def _exchange(self, data: bytes, now_s: float, baud: int) -> list[Reply]:
        """What comes back to what somebody sends, by the time at which it has left the wire."""
        byte_s = BITS_PER_BYTE / baud if self.paced else 0.0
        begin_s = max(now_s, self._free_s)
        if now_s - self._heard_s > PAUSE_S:
            self._parser.reset()
        self._heard_s = now_s
        self._free_s = begin_s + len(data) * byte_s
        held = self.faults.take_held()
        replies: list[Reply] = [Reply(begin_s, held)] if held else []
        if self.faults.echo:
            replies.append(Reply(self._free_s, data))
        for instruction in self._parser.feed(data):
            complete_s = begin_s + (len(data) - self._parser.pending) * byte_s
            self.advance(complete_s)
            replies += self._obey(instruction, complete_s, byte_s, self._listening(baud))
            self.after_instructions()
        replies += self._silence(self._free_s, byte_s)
        replies.sort(key=lambda reply: reply.due_s)
        if replies:
            self._free_s = max(self._free_s, replies[-1].due_s)
        return replies

    def _through_adapter(self, replies: list[Reply]) -> list[Reply]:
        """The replies as the master gets them: what the adapter holds back holds up all that comes behind it."""
        late = any(reply.held_s for reply in replies)
        if not replies or not (late or replies[0].due_s < self._handed_over_s):
            return replies
        through = []
        for reply in replies:
            self._handed_over_s = max(self._handed_over_s, reply.due_s + reply.held_s)
            through.append(Reply(self._handed_over_s, reply.data))
        return through

    def _listening(self, baud: int) -> list[AnyServo]:
        """Servos that understand this baud and are there. The others hear garbage, or nothing."""
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
    def _obey(self, instruction: Instruction, at_s: float, byte_s: float, servos: Sequence[AnyServo]) -> list[Reply]:
        """Let ``servos`` do one instruction; whatever comes back, in order."""

    def _silence(self, at_s: float, byte_s: float) -> list[Reply]:
        """What servos say only when the line is silent: the master's bytes end at ``at_s``."""
        return []

    def _in_turn(self, turns: Iterable[Turn], at_s: float, byte_s: float, slot_s: float) -> list[Reply]:
        """Replies one after the other; a turn without a reply lasts ``slot_s``."""
        replies = []
        for delay_s, packets in turns:
            if not packets:
                at_s += slot_s
                continue
            reply = self._reply(packets, at_s + (delay_s if self.paced else 0.0), byte_s)
            replies.append(reply)
            at_s = reply.due_s
        return replies

    def _reply(self, packets: Sequence[bytes], begin_s: float, byte_s: float) -> Reply:
        """What comes out of the wire when these packets are sent at once."""
        servo_id = packets[0][self._id_at]
        data = self.faults.pass_reply(servo_id, overlaid(packets))
        return Reply(begin_s + max(map(len, packets)) * byte_s, data, self.faults.held_s(servo_id))

    def _answers(self, instruction: Instruction, servos: Sequence[AnyServo]) -> list[Turn]:
        """All do the instruction; answers with the same ID in them come at the same time."""
        turns: dict[int, Turn] = {}
        for servo in sorted(servos, key=lambda servo: servo.servo_id):
            packet = servo.answer(instruction)
            if packet is not None:
                turns.setdefault(packet[self._id_at], (servo.return_delay_s, []))[1].append(packet)
        return list(turns.values())


def _nothing() -> None:
    pass


def named(servo_id: int, servos: Sequence[AnyServo]) -> list[AnyServo]:
    """Those that answer to this ID."""
    return [servo for servo in servos if servo.servo_id == servo_id]


def overlaid(packets: Sequence[bytes]) -> bytes:
    """Packets sent at once on one line whose idle level is 1."""
    if len(packets) == 1:
        return packets[0]
    length = max(map(len, packets))
    merged = bytearray(b"\xff" * length)
    for packet in packets:
        for i, byte in enumerate(packet):
            merged[i] &= byte
    return bytes(merged)
