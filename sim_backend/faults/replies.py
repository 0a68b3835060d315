"""Faults of packets on the wire. Each fault has its own probability and its own sequence of random numbers."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from random import Random
from typing import Any, ClassVar, Final, Literal

from hal.plausible import Delay, ServoId
from sim_backend.faults.event import Replies
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.tails import log_uniform
from sim_backend.faults.targets import FaultTargets, Inventory
from sim_backend.line.line import overlaid
from sim_backend.packets.faults import LONGEST_NOISE

SEVERAL_CYCLES: Final = 0.7
"""Fraction of the drawn late replies that are late by several cycles."""
LOOSE: Final = 0.5
"""Fraction of the drawn ``lost_replies`` faults that lose single replies for several seconds, as with a loose
connector."""


class _OnTheWire(Replies):
    """A fault that affects each reply with a probability."""

    def spoil(self, random: Random, packet: bytes) -> bytes:
        """Return the reply after the fault has changed it."""
        raise NotImplementedError

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        random = self.stream()

        def become(servo_id: int, packet: bytes) -> bytes:
            hit = self.hit(random, servo_id)
            return self.spoil(hit, packet) if hit and packet else packet

        with _listed(targets, self.bus, "on_reply", become):
            yield

    def hit(self, random: Random, servo_id: int) -> Random | None:
        """Return the random generator for this reply's effect, or None if the reply is not affected.

        Each reply that could be affected consumes one number from ``random``. The effect on the next reply is therefore
        independent of other faults of this reply.
        """
        if self.servo_id not in (None, servo_id):
            return None
        number = random.random()
        return Random(number) if number < self.chance else None


class LostReplies(_OnTheWire):
    """Replies are lost on the wire."""

    kind: Literal["lost_replies"] = "lost_replies"

    def spoil(self, random: Random, packet: bytes) -> bytes:
        return b""

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        parameters = super().draw_parameters(random, there)
        if random.random() >= LOOSE:
            return parameters
        return {**parameters, "chance": log_uniform(random, 0.1, 0.5), "for_s": log_uniform(random, 1.0, 6.0)}


class TruncatedReplies(_OnTheWire):
    """Only the beginning of a reply arrives."""

    kind: Literal["truncated_replies"] = "truncated_replies"

    def spoil(self, random: Random, packet: bytes) -> bytes:
        # Another fault may already have truncated the reply to one byte.
        return packet[: random.randrange(1, len(packet))] if len(packet) > 1 else packet


class FlippedReplies(_OnTheWire):
    """One bit of a reply arrives inverted."""

    kind: Literal["flipped_replies"] = "flipped_replies"

    def spoil(self, random: Random, packet: bytes) -> bytes:
        bit = random.randrange(len(packet) * 8)
        return (int.from_bytes(packet, "big") ^ 1 << bit).to_bytes(len(packet), "big")


class Noise(_OnTheWire):
    """Noise bytes arrive before a reply."""

    kind: Literal["noise"] = "noise"

    def spoil(self, random: Random, packet: bytes) -> bytes:
        return random.randbytes(random.randint(1, LONGEST_NOISE)) + packet


class Collision(_OnTheWire):
    """Another servo repeats its last reply at the same time. The two replies overlap on the wire."""

    kind: Literal["collision"] = "collision"
    servo_id: ServoId
    other_id: ServoId

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        there.bus_of(self.other_id, there.bus_of(self.servo_id, self.bus))

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        random, last_reply = self.stream(), b""

        def become(servo_id: int, packet: bytes) -> bytes:
            nonlocal last_reply
            if servo_id == self.other_id and packet:
                last_reply = packet
            hit = self.hit(random, servo_id)
            return overlaid([packet, last_reply]) if hit and packet and last_reply else packet

        with _listed(targets, targets.inventory.bus_of(self.servo_id, self.bus), "on_reply", become):
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        parameters = super().draw_parameters(random, there)
        shared = [name for name, servos in there.servos.items() if len(servos) > 1]
        if not shared:
            raise FaultError("no bus has two servos whose replies could collide")
        bus = random.choice(shared)
        one, other = random.sample(list(there.servos[bus]), 2)
        return {**parameters, "bus": bus if len(there.servos) > 1 else None, "servo_id": one, "other_id": other}


class LateReplies(Replies):
    """The adapter delays some replies, which also delays all replies after them."""

    kind: Literal["late_replies"] = "late_replies"
    WEIGHT: ClassVar[int] = 3  # An old position that is mistaken for a new one shows only while the joint moves.
    by_s: Delay = 0.02

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        random = self.stream()

        def held(servo_id: int) -> float:
            hit = self.servo_id in (None, servo_id) and random.random() < self.chance
            return self.by_s if hit else 0.0

        with _listed(targets, self.bus, "on_arrival", held):
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        parameters = super().draw_parameters(random, there)
        if random.random() < SEVERAL_CYCLES:
            lasting = {"chance": log_uniform(random, 0.1, 1.0), "for_s": log_uniform(random, 0.05, 5.0)}
            return {**parameters, **lasting, "by_s": log_uniform(random, 0.1, 0.5)}
        return {**parameters, "by_s": log_uniform(random, 0.0002, 1.0)}


class MissedInstructions(Replies):
    """Instructions to a servo arrive damaged, so the servo ignores them."""

    kind: Literal["missed_instructions"] = "missed_instructions"

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        random = self.stream()

        def reaches(servo_id: int) -> bool:
            return self.servo_id not in (None, servo_id) or random.random() >= self.chance

        with _listed(targets, self.bus, "on_instruction", reaches):
            yield


@contextmanager
def _listed(targets: FaultTargets, bus: str | None, where: str, act: Callable[..., Any]) -> Iterator[None]:
    """While the context is active, add ``act`` to one of the fault lists of each bus."""
    lists: list[list[Any]] = [getattr(line.faults, where) for line in targets.lines_of(bus)]
    for each in lists:
        each.append(act)
    try:
        yield
    finally:
        for each in lists:
            each.remove(act)
