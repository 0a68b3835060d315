"""Base classes of all faults, with the start time, the duration, and the affected servo or bus."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from random import Random
from typing import Any, ClassVar, Final, Self

from pydantic import BaseModel, ConfigDict, field_validator

from drivers.servos.register import ServoModel
from hal.plausible import Chance, Duration, Seed, ServoId, Time
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.tails import log_uniform
from sim_backend.faults.targets import FaultPlace, FaultTargets, Inventory, Since

DRAWN_S: Final = (0.001, 20.0)
"""Range of drawn fault durations, in seconds: from one packet to an entire run with a job."""
USUAL_S: Final = (0.05, 2.0)
"""Range of durations for half of the drawn faults, in seconds: from one cycle to longer than every time-out of
the stack."""
STAYS: Final = 0.1
"""Fraction of the drawn faults that do not end. Momentary faults are not counted."""


class Event(BaseModel):
    """A fault that starts at a given time. ``kind`` is the name of the fault, and the other fields are its
    parameters."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    WEIGHT: ClassVar[int] = 1
    """How much more often than other types this type of fault is drawn."""
    kind: str
    at_s: Time = 0.0
    """Time from the moment specified by ``since`` to the start of the fault, in seconds."""
    since: Since = "up"
    """Moment to which the start time is relative. An emulator supports only ``up``, the moment when it is ready."""
    for_s: Duration | None = None
    """Duration in seconds; None if the fault does not end."""

    def refuse(self, there: Inventory) -> None:
        """Raise FaultError with the reason if no target in the inventory can have this fault."""
        if self.since not in there.moments:
            does = {"start": "starts", "up": "comes up", "end": "ends"}[self.since]
            raise FaultError(
                f"there is no stack here that {does}: omit `since`, or play the fault with servoloop campaign"
            )

    def acting(self, targets: FaultTargets) -> AbstractContextManager[None]:
        """Return a context manager that keeps the fault active. The fault starts on entry and ends on exit."""
        raise NotImplementedError

    @property
    def lasts_s(self) -> float | None:
        """Time from the start to the end of the fault, in seconds; None if the fault does not end."""
        return self.for_s

    def stream(self) -> Random:
        """Return the random generator of this event, which is independent of those of other events."""
        return Random(f"{getattr(self, 'seed', 0)}/{self.kind}")

    @classmethod
    def drawn(cls, random: Random, there: Inventory, at_s: float, since: Since = "up") -> Self:
        """Draw an event of this type with random parameters. Raises FaultError if no target can have such an event."""
        parameters = cls.draw_parameters(random, there)
        event = cls.model_validate({"at_s": at_s, "since": since, **parameters})
        event.refuse(there)
        return event

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        """Draw all parameters of an event except for its time."""
        return {}


class Lasting(Event):
    """A fault that ends after ``for_s`` or does not end."""

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        length_s = log_uniform(random, *random.choice((DRAWN_S, USUAL_S)))
        return {"for_s": None if random.random() < STAYS else length_s}


class Momentary(Event):
    """A fault that ends immediately after it starts. Its effects remain."""

    for_s: None = None

    @field_validator("for_s", mode="before")
    @classmethod
    def _over_at_once(cls, for_s: object) -> None:
        if for_s is not None:
            raise ValueError(f"{cls.model_fields['kind'].default} has no duration: omit for_s")

    @property
    def lasts_s(self) -> float | None:
        return 0.0


class OfServo(Event):
    """A fault of one servo. ``servo_id`` is the ID that the servo had when it was mounted."""

    servo_id: ServoId
    bus: str | None = None
    """Name of the bus, needed only if several buses have a servo with this ID."""

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        self.refuse_model(self.model(there), there)

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        """Raise FaultError if a servo of this model cannot have the fault."""

    def model(self, there: Inventory) -> ServoModel:
        """Return the servo's model. Raises FaultError if the servo does not exist."""
        return there.servos[there.bus_of(self.servo_id, self.bus)][self.servo_id]

    def place(self, targets: FaultTargets) -> FaultPlace:
        """Return the position of the servo on its bus."""
        return targets.place(self.servo_id, self.bus)

    def cannot(self, model: ServoModel, why: str) -> FaultError:
        """Return the error for a servo that cannot have the fault."""
        return FaultError(f"servo {self.servo_id} is an {model.name}, which {why}: it cannot have {self.kind!r}")

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), **any_servo(random, there.servos)}


class OfBus(Event):
    """A fault of one bus or of all buses."""

    bus: str | None = None
    """Name of the bus; None for all buses."""

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        there.require_bus(self.bus)

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        bus = random.choice([None, *there.servos]) if len(there.servos) > 1 else None
        return {**super().draw_parameters(random, there), "bus": bus}


class Replies(OfBus, Lasting):
    """A fault of replies on the wire, of one servo or of all servos. Each reply is affected with a probability."""

    servo_id: ServoId | None = None
    """ID of the servo; None for the replies of all servos."""
    chance: Chance = 1.0
    """Probability for each reply."""
    seed: Seed = 0
    """Random seed."""

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        if self.servo_id is not None:
            there.bus_of(self.servo_id, self.bus)

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        chance, seed = log_uniform(random, 0.01, 1.0), random.randrange(1 << 16)
        return {**super().draw_parameters(random, there), "chance": chance, "seed": seed}


def model_of(drawn: Mapping[str, Any], there: Inventory) -> ServoModel:
    """Return the model of the servo that the drawn parameters select."""
    return there.servos[there.bus_of(drawn["servo_id"], drawn["bus"])][drawn["servo_id"]]


def any_servo(random: Random, servos: Mapping[str, Mapping[int, ServoModel]]) -> dict[str, Any]:
    """Choose a servo at random."""
    bus, servo_id = random.choice([(bus, servo_id) for bus, ids in servos.items() for servo_id in ids])
    return {"bus": bus if len(servos) > 1 else None, "servo_id": servo_id}
