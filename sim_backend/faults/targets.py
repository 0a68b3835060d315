"""What faults can be done to: lines of servos, the world, adapters, and the stack above them."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from random import Random
from typing import Any, Final, Literal, Protocol

from drivers.servos.register import ServoModel
from sim_backend.faults.errors import FaultError
from sim_backend.faults.holds import Holds
from sim_backend.line.line import ServoLine

Upset = Literal["raises", "nan", "jumps"]
"""What a controller does when it is upset."""
Misdeed = Literal["nonsense", "cancels", "dies"]
"""What a client of the stack does."""
Since = Literal["start", "up", "end"]
"""The moment from which a fault's time counts: before the hardware is configured, when the arm is up, or when the
program begins to end."""
START_S: Final = 0.1
"""Time in which the shipped arms are configured and activated: 0.04 s on STS servos, 0.1 s on Dynamixels."""
HOLD_S: Final = 0.2
"""Time in which an arm that is held at the program's end has come to rest."""


class Adapter(Protocol):
    """The adapter between a line and the computer."""

    def unplug(self) -> None:
        """Pull it: whoever has it open has lost it."""

    def plug(self, name: str | None) -> None:
        """Put it back, under its former name or another."""


class Mechanics(Protocol):
    """What faults need of ``sim_backend.scene.world.World``."""

    def jam(self, joint: str) -> None:
        """Block the joint's gears."""

    def free(self, joint: str) -> None:
        """Undo ``jam``."""

    def load(self, joint: str, effort: float) -> None:
        """Pull at the joint with ``effort`` (N m, or N) more than before."""


class StackTarget(Protocol):
    """The stack with its controllers and its clients, on simulated time."""

    @property
    def controllers(self) -> Mapping[str, bool]:
        """The names of the controllers, and whether each commands joints."""

    def stall(self, seconds: float) -> None:
        """Let the machine stand still for so long once; the servos and the world go on."""

    def upset(self, controller: str | None, how: Upset, jump: float) -> AbstractContextManager[None]:
        """While the context lasts a controller (by name; None: that of the arm) raises in its update, or adds NaN
        or ``jump`` (rad or m) to its commands."""

    def misbehave(self, what: Misdeed, random: Random) -> None:
        """Let a client do this now; it draws what it needs from ``random``."""


@dataclass(frozen=True, slots=True)
class Inventory:
    """What there is, without its being there: schedules are drawn and checked from this."""

    servos: Mapping[str, Mapping[int, ServoModel]]
    """The servos of each line in the order of their chain."""
    world: bool = True
    adapters: bool = True
    stack: bool = True
    controllers: Mapping[str, bool] = field(default_factory=dict)
    """The controllers of the stack as far as they are known, and whether each commands joints."""
    start_s: float | None = START_S
    """Time that the stack takes to come up. None: it is up already."""
    end_s: float | None = HOLD_S
    """Time that the program takes to end. None: it is not ended here."""

    @property
    def moments(self) -> tuple[Since, ...]:
        """The moments from which faults can count here, in their order."""
        there: dict[Since, bool] = {
            "start": self.stack and self.start_s is not None,
            "up": True,
            "end": self.stack and self.end_s is not None,
        }
        return tuple(moment for moment, known in there.items() if known)

    def bus_of(self, servo_id: int, bus: str | None) -> str:
        """The name of the line that has this servo. Raises FaultError where there is none, or one on several lines."""
        self.require_bus(bus)
        found = [name for name, servos in self.servos.items() if servo_id in servos and bus in (None, name)]
        if not found:
            known = "; ".join(f"{name + ' has ' if name else ''}{_ids(ids)}" for name, ids in self.servos.items())
            raise FaultError(f"there is no servo {servo_id}{f' on bus {bus}' if bus else ''}: known are {known}")
        if len(found) > 1:
            raise FaultError(f"several lines have a servo {servo_id}: name one with bus, of {', '.join(found)}")
        return found[0]

    def require_bus(self, bus: str | None) -> None:
        """Raise FaultError where there is no such line; None is all of them."""
        if not self.servos:
            raise FaultError("there is no line here whose servos could be named (those from a box all have one ID)")
        if bus is not None and bus not in self.servos:
            raise FaultError(f"there is no bus {bus!r}: known are {', '.join(map(repr, self.servos))}")

    def buses(self, bus: str | None) -> list[str]:
        """The names of the lines that ``bus`` means."""
        return list(self.servos) if bus is None else [bus]


def _ids(servos: Mapping[int, ServoModel]) -> str:
    return ", ".join(map(str, servos))


@dataclass(frozen=True, slots=True)
class Place:
    """A servo where it was mounted, whatever ID it has now."""

    line: ServoLine[Any]
    number: int
    """Its place on the line."""

    @property
    def servo(self) -> Any:
        return self.line.servos[self.number]

    @property
    def joint(self) -> str:
        return self.line.rig.plant.couplings[self.number].joint

    @property
    def ratio(self) -> float:
        """Joint units per radian of the shaft, with the sign."""
        return self.line.rig.plant.couplings[self.number].ratio


@dataclass(slots=True)
class Targets:
    """What faults are done to; servos are named by the IDs that they were mounted with."""

    lines: Mapping[str, ServoLine[Any]]
    world: Mechanics | None = None
    adapters: Mapping[str, Adapter] = field(default_factory=dict)
    stack: StackTarget | None = None
    holds: Holds = field(default_factory=Holds)
    _each_step: list[Callable[[float], None]] = field(default_factory=list)

    @property
    def inventory(self) -> Inventory:
        """What there is."""
        servos = {
            name: {
                coupling.servo_id: servo.model
                for coupling, servo in zip(line.rig.plant.couplings, line.servos, strict=True)
            }
            for name, line in self.lines.items()
        }
        controllers = self.stack.controllers if self.stack is not None else {}
        return Inventory(servos, self.world is not None, bool(self.adapters), self.stack is not None, controllers)

    def place(self, servo_id: int, bus: str | None) -> Place:
        """Where the servo is."""
        line = self.lines[self.inventory.bus_of(servo_id, bus)]
        ids = [coupling.servo_id for coupling in line.rig.plant.couplings]
        return Place(line, ids.index(servo_id))

    def lines_of(self, bus: str | None) -> list[ServoLine[Any]]:
        """One line, or all."""
        return [self.lines[name] for name in self.inventory.buses(bus)]

    @contextmanager
    def each_step(self, act: Callable[[float], None]) -> Iterator[None]:
        """While the context lasts ``act(time_s)`` is called after each step of the world."""
        self._each_step.append(act)
        try:
            yield
        finally:
            self._each_step.remove(act)

    def step(self, time_s: float) -> None:
        """A step of the world is done."""
        for act in self._each_step:
            act(time_s)
