"""Faults of packets on the virtual wire."""

import random
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

LONGEST_NOISE: Final = 6
"""Maximum number of noise bytes: less than half a reply, as after a glitch of the supply."""


@dataclass(slots=True)
class Disturbance:
    """Random disturbances on the wire, determined by a seed.

    ``drop``, ``flip`` and ``noise`` are the probabilities that a reply is lost, arrives with a flipped bit, or arrives
    after noise. ``miss`` is the probability that an instruction does not reach a servo. ``done`` counts the
    disturbances, keyed by type and servo ID, for comparison with the error counters of a driver.
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
        """Return whether an instruction reaches this servo intact."""
        if self.miss == 0.0 or self._random.random() >= self.miss:
            return True
        self.done["miss", servo_id] += 1
        return False

    def pass_reply(self, servo_id: int, packet: bytes) -> bytes:
        """Return the reply as it leaves the wire, with at most one disturbance."""
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
    """Fault switches that the bus checks when a servo receives or replies. Servos are identified by ID."""

    def __init__(self) -> None:
        self.mute: set[Any] = set()
        """Servos whose data lines are broken, regardless of their IDs."""
        self.echo = False
        """Whether the adapter receives the bytes that it sends."""
        self.on_reply: list[Callable[[int, bytes], bytes]] = []
        """Functions that change a reply (servo ID, packet) on the wire, applied in order."""
        self.on_instruction: list[Callable[[int], bool]] = []
        """Functions that decide whether an instruction reaches the servo. The instruction reaches the servo only if all
        these functions return true."""
        self.on_arrival: list[Callable[[int], float]] = []
        """Functions that return how long the adapter delays a servo's reply, in seconds."""
        self.foreign: deque[bytes] = deque(maxlen=1)
        """Packet of another program that is sent before the master's next packet."""
        self._silent: set[int] = set()
        self._corrupt: dict[int, int] = {}
        self._late: set[int] = set()
        self._held: list[bytes] = []
        self.disturbance: Disturbance | None = None

    def silence(self, servo_id: int) -> None:
        """Break the servo's data line. The servo neither receives nor replies until ``restore`` is called."""
        self._silent.add(servo_id)

    def restore(self, servo_id: int) -> None:
        """Repair the data line that ``silence`` broke."""
        self._silent.discard(servo_id)

    def corrupt_next(self, servo_id: int, replies: int = 1) -> None:
        """Corrupt the checksum of the servo's next replies."""
        self._corrupt[servo_id] = self._corrupt.get(servo_id, 0) + replies

    def delay_next(self, servo_id: int) -> None:
        """Delay the servo's next reply until the master has sent another instruction."""
        self._late.add(servo_id)

    def take_held(self) -> bytes:
        """Return the delayed replies that arrive now."""
        held = b"".join(self._held)
        self._held.clear()
        return held

    def is_silent(self, servo_id: int) -> bool:
        """Return whether the servo's data line is broken."""
        return servo_id in self._silent

    def hears(self, servo_id: int) -> bool:
        """Return whether the next instruction reaches the servo."""
        reached = not self.is_silent(servo_id) and (self.disturbance is None or self.disturbance.reaches(servo_id))
        for reaches in self.on_instruction:  # Call all functions, because each draws its own random number.
            reached = reaches(servo_id) and reached
        return reached

    def held_s(self, servo_id: int) -> float:
        """Return how long the adapter delays the servo's next reply, in seconds."""
        return sum(held(servo_id) for held in self.on_arrival)

    def pass_reply(self, servo_id: int, packet: bytes) -> bytes:
        """Return a reply as it leaves the adapter now."""
        return self.through_adapter(servo_id, self.on_wire(servo_id, packet))

    def on_wire(self, servo_id: int, packet: bytes) -> bytes:
        """Return a reply as the other servos on the wire receive it."""
        if self.disturbance is not None:
            packet = self.disturbance.pass_reply(servo_id, packet)
        for become in self.on_reply:
            packet = become(servo_id, packet)
        left = self._corrupt.get(servo_id, 0)
        if not left or not packet or servo_id in self._late:
            return packet
        self._corrupt[servo_id] = left - 1
        return packet[:-1] + bytes((packet[-1] ^ 0xFF,))

    def through_adapter(self, servo_id: int, packet: bytes) -> bytes:
        """Return a reply from the wire, or no bytes if ``delay_next`` delays the reply."""
        if servo_id not in self._late:
            return packet
        self._late.remove(servo_id)
        self._held.append(packet)
        return b""
