"""What all faults have in common: a time, a duration, the servo or the line that they are about."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from random import Random
from typing import Any, Final, Self

from pydantic import BaseModel, ConfigDict, field_validator

from drivers.servos.register import ServoModel
from hal.plausible import Chance, Duration, Seed, ServoId, Time
from sim_backend.faults.errors import FaultError
from sim_backend.faults.tails import log_uniform
from sim_backend.faults.targets import Inventory, Place, Since, Targets

DRAWN_S: Final = (0.001, 20.0)
"""Durations of drawn faults that end: from one packet to a whole run with a job."""
USUAL_S: Final = (0.05, 2.0)
"""Durations of half of them: from a cycle to what outlasts every time-out of the stack."""
STAYS: Final = 0.1
"""Of the drawn faults that could end so many stay."""


class Event(BaseModel):
    """A fault at one time: ``kind`` names it, its other fields are the parameters."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kind: str
    at_s: Time = 0.0
    """Time of the beginning, counted from ``since``."""
    since: Since = "up"
    """An emulator is up when it is ready, and knows no other moment."""
    for_s: Duration | None = None
    """How long it lasts. None: it stays."""

    def refuse(self, there: Inventory) -> None:
        """Raise FaultError, with a sentence that says why, where what there is cannot have this fault."""
        if self.since not in there.moments:
            does = {"start": "starts", "up": "comes up", "end": "ends"}[self.since]
            raise FaultError(f"no stack {does} here: leave out `since`, or play the fault with servoloop campaign")

    def acting(self, targets: Targets) -> AbstractContextManager[None]:
        """The fault itself: it begins as the context is entered and ends as that is left."""
        raise NotImplementedError

    @property
    def lasts_s(self) -> float | None:
        """How long after its beginning it ends; None: never."""
        return self.for_s

    def stream(self) -> Random:
        """The event's own random numbers: what it draws changes nobody else's."""
        return Random(f"{getattr(self, 'seed', 0)}/{self.kind}")

    @classmethod
    def drawn(cls, random: Random, there: Inventory, at_s: float, since: Since = "up") -> Self:
        """An event of this kind with random parameters. Raises FaultError where nothing can have it."""
        parameters = cls.draw_parameters(random, there)
        event = cls.model_validate({"at_s": at_s, "since": since, **parameters})
        event.refuse(there)
        return event

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        """What ``drawn`` fills in beside the time."""
        return {}


class Lasting(Event):
    """A fault that ends by itself after ``for_s``, or stays."""

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        length_s = log_uniform(random, *random.choice((DRAWN_S, USUAL_S)))
        return {"for_s": None if random.random() < STAYS else length_s}


class Momentary(Event):
    """A fault that is done as soon as it has begun; what it did stays."""

    for_s: None = None

    @field_validator("for_s", mode="before")
    @classmethod
    def _over_at_once(cls, for_s: object) -> None:
        if for_s is not None:
            raise ValueError(f"{cls.model_fields['kind'].default} is over at once: leave out for_s")

    @property
    def lasts_s(self) -> float | None:
        return 0.0


class OfServo(Event):
    """A fault of one servo, which is named by the ID that it was mounted with."""

    servo_id: ServoId
    bus: str | None = None
    """The line's name, where several lines have a servo of this ID."""

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        self.refuse_model(self.model(there), there)

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        """Raise FaultError where a servo of this model cannot have the fault."""

    def model(self, there: Inventory) -> ServoModel:
        """The servo's model. Raises FaultError where there is no such servo."""
        return there.servos[there.bus_of(self.servo_id, self.bus)][self.servo_id]

    def place(self, targets: Targets) -> Place:
        """Where the servo is."""
        return targets.place(self.servo_id, self.bus)

    def cannot(self, model: ServoModel, why: str) -> FaultError:
        """The refusal of a servo that cannot have the fault."""
        return FaultError(f"servo {self.servo_id} is a {model.name}, which {why}: it cannot have {self.kind!r}")

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), **any_servo(random, there.servos)}


class OfBus(Event):
    """A fault of a line, or of all lines."""

    bus: str | None = None
    """The line's name; None: all lines."""

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        there.require_bus(self.bus)

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        bus = random.choice([None, *there.servos]) if len(there.servos) > 1 else None
        return {**super().draw_parameters(random, there), "bus": bus}


class Replies(OfBus, Lasting):
    """A fault of replies on the wire, of one servo's or of all, each with a chance of its own."""

    servo_id: ServoId | None = None
    """None: the replies of all servos."""
    chance: Chance = 1.0
    """For each reply."""
    seed: Seed = 0
    """Of the draws."""

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        if self.servo_id is not None:
            there.bus_of(self.servo_id, self.bus)

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        chance, seed = log_uniform(random, 0.01, 1.0), random.randrange(1 << 16)
        return {**super().draw_parameters(random, there), "chance": chance, "seed": seed}


def model_of(drawn: Mapping[str, Any], there: Inventory) -> ServoModel:
    """The model of the servo that drawn parameters name."""
    return there.servos[there.bus_of(drawn["servo_id"], drawn["bus"])][drawn["servo_id"]]


def any_servo(random: Random, servos: Mapping[str, Mapping[int, ServoModel]]) -> dict[str, Any]:
    """Name a servo by chance."""
    bus, servo_id = random.choice([(bus, servo_id) for bus, ids in servos.items() for servo_id in ids])
    return {"bus": bus if len(servos) > 1 else None, "servo_id": servo_id}
