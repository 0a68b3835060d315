"""What can be made to go wrong on the virtual wire."""

import random
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

LONGEST_NOISE: Final = 6
"""Bytes; less than half a reply, as a glitch of the supply leaves."""


@dataclass(slots=True)
class Disturbance:
    """Chance for each reply to be dropped, to arrive with a flipped bit, or behind noise, and for each instruction
    not to reach a servo (``miss``). By seed.

    ``done`` counts what was done to whom: (kind, servo ID), to hold a driver's counters against it.
    """

    seed: int
    drop: float = 0.0
    flip: float = 0.0
    noise: float = 0.0
    miss: float = 0.0
    done: Counter[tuple[str, int]] = field(default_factory=Counter)
    _random: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)

    def reaches(self, servo_id: int) -> bool:
        """Whether an instruction comes to this servo in one piece."""
        if self.miss == 0.0 or self._random.random() >= self.miss:
            return True
        self.done["miss", servo_id] += 1
        return False

    def pass_reply(self, servo_id: int, packet: bytes) -> bytes:
        """The reply as it comes out of the wire; at most one thing happens to it."""
        chance = self._random.random()
        if chance < self.drop:
            self.done["drop", servo_id] += 1
            return b""
        if chance < self.drop + self.flip:
            self.done["flip", servo_id] += 1
            bit = self._random.randrange(len(packet) * 8)
            return (int.from_bytes(packet, "big") ^ 1 << bit).to_bytes(len(packet), "big")
        if chance < self.drop + self.flip + self.noise:
            self.done["noise", servo_id] += 1
            return self._random.randbytes(self._random.randint(1, LONGEST_NOISE)) + packet
        return packet


class WireFaults:
    """Switches that the bus looks at whenever a servo is about to reply. Servos are named by ID."""

    def __init__(self) -> None:
        self.mute: set[Any] = set()
        """Servos, whatever their IDs, whose data lines are broken."""
        self.echo = False
        """Whether the adapter hears what it sends."""
        self.on_reply: list[Callable[[int, bytes], bytes]] = []
        """What a reply of a servo (its ID) becomes on the wire, one after the other."""
        self.on_instruction: list[Callable[[int], bool]] = []
        """Whether an instruction reaches the servo: each of these must say so."""
        self.on_arrival: list[Callable[[int], float]] = []
        """For how long (s) the adapter holds a reply of the servo back."""
        self.foreign: deque[bytes] = deque(maxlen=1)
        """The packet of another program that goes out before the master's next one."""
        self._silent: set[int] = set()
        self._corrupt: dict[int, int] = {}
        self._late: set[int] = set()
        self._held: list[bytes] = []
        self.disturbance: Disturbance | None = None

    def silence(self, servo_id: int) -> None:
        """The servo's data line breaks: it neither hears nor answers until ``restore``."""
        self._silent.add(servo_id)

    def restore(self, servo_id: int) -> None:
        """Mend what ``silence`` broke."""
        self._silent.discard(servo_id)

    def corrupt_next(self, servo_id: int, replies: int = 1) -> None:
        """The next replies of the servo arrive with a wrong checksum."""
        self._corrupt[servo_id] = self._corrupt.get(servo_id, 0) + replies

    def delay_next(self, servo_id: int) -> None:
        """The next reply of the servo comes when the master has asked somebody again."""
        self._late.add(servo_id)

    def take_held(self) -> bytes:
        """Replies that were held back and come now."""
        held = b"".join(self._held)
        self._held.clear()
        return held

    def is_silent(self, servo_id: int) -> bool:
        """Whether the servo is cut off."""
        return servo_id in self._silent

    def hears(self, servo_id: int) -> bool:
        """Whether the next instruction reaches the servo."""
        reached = not self.is_silent(servo_id) and (self.disturbance is None or self.disturbance.reaches(servo_id))
        for reaches in self.on_instruction:  # each draws its own, whatever the others say
            reached = reaches(servo_id) and reached
        return reached

    def held_s(self, servo_id: int) -> float:
        """For how long the adapter holds back the servo's next reply."""
        return sum(held(servo_id) for held in self.on_arrival)

    def pass_reply(self, servo_id: int, packet: bytes) -> bytes:
        """A reply as it comes out of the wire."""
        if self.disturbance is not None:
            packet = self.disturbance.pass_reply(servo_id, packet)
        for become in self.on_reply:
            packet = become(servo_id, packet)
        if servo_id in self._late:
            self._late.remove(servo_id)
            self._held.append(packet)
            return b""
        left = self._corrupt.get(servo_id, 0)
        if not left or not packet:
            return packet
        self._corrupt[servo_id] = left - 1
        return packet[:-1] + bytes((packet[-1] ^ 0xFF,))
