"""Targets of faults: servo buses, the world, adapters, and the stack above them."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from random import Random
from typing import Any, Final, Literal, Protocol

from drivers.servos.register import ServoModel
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.holds import Holds
from sim_backend.line.line import ServoLine

ControllerFault = Literal["raises", "nan", "jumps"]
"""Type of controller failure."""
ClientFault = Literal["nonsense", "cancels", "dies"]
"""Type of client misbehavior."""
Since = Literal["start", "up", "end"]
"""Moment to which the time of a fault is relative: before the hardware is configured, when the arm is active, or when
the program begins to exit."""
START_S: Final = 0.1
"""Time to configure and activate the arms that ship with servoloop, in seconds: 0.04 s with STS servos, 0.1 s with
Dynamixels."""
HOLD_S: Final = 0.2
"""Time an arm takes to come to rest if it holds its position when the program exits, in seconds."""


class FaultyAdapter(Protocol):
    """The adapter between a bus and the computer."""

    def unplug(self) -> None:
        """Unplug the adapter. Every program that has opened the adapter loses the connection."""

    def plug(self, name: str | None) -> None:
        """Plug the adapter in again, under the same name or a different name."""


class Mechanics(Protocol):
    """The part of ``sim_backend.scene.world.World`` that faults use."""

    def jam(self, joint: str) -> None:
        """Block the joint's gears."""

    def free(self, joint: str) -> None:
        """Undo ``jam``."""

    def load(self, joint: str, effort: float) -> None:
        """Add ``effort`` (N m, or N) to the external load on the joint."""


class StackTarget(Protocol):
    """The stack with its controllers and its clients, in simulated time."""

    @property
    def controllers(self) -> Mapping[str, bool]:
        """Whether each controller commands joints, keyed by controller name."""

    def stall(self, seconds: float) -> None:
        """Stall the computer once for this time. The servos and the world continue to run."""

    def disturb_controller(
        self, controller: str | None, how: ControllerFault, jump: float
    ) -> AbstractContextManager[None]:
        """While the context is active, make a controller raise an exception in its update, or add ``jump`` (rad or m,
        NaN or infinity) to the controller's commands.

        ``controller`` is a name, or None for the arm's controller.
        """

    def disturb_client(self, what: ClientFault, random: Random) -> None:
        """Make a client perform this action now, with details drawn from ``random``."""


@dataclass(frozen=True, slots=True)
class Inventory:
    """Description of the servos, buses and other fault targets. Schedules are drawn and checked from this description,
    without the targets themselves."""

    servos: Mapping[str, Mapping[int, ServoModel]]
    """Servo models on each bus, keyed by ID, in daisy-chain order."""
    world: bool = True
    adapters: bool = True
    stack: bool = True
    controllers: Mapping[str, bool] = field(default_factory=dict)
    """Whether each known controller of the stack commands joints, keyed by controller name."""
    start_s: float | None = START_S
    """Time the stack needs to start, in seconds; None if the stack is already up."""
    end_s: float | None = HOLD_S
    """Time the program needs to exit, in seconds; None if the program's exit is not part of the run."""

    @property
    def moments(self) -> tuple[Since, ...]:
        """Moments to which fault times can be relative here, in chronological order."""
        there: dict[Since, bool] = {
            "start": self.stack and self.start_s is not None,
            "up": True,
            "end": self.stack and self.end_s is not None,
        }
        return tuple(moment for moment, known in there.items() if known)

    def bus_of(self, servo_id: int, bus: str | None) -> str:
        """Return the name of the bus that has this servo. Raises FaultError if the servo is not on any bus, or if it is
        on more than one bus."""
        self.require_bus(bus)
        found = [name for name, servos in self.servos.items() if servo_id in servos and bus in (None, name)]
        if not found:
            known = "; ".join(f"{name + ' has ' if name else ''}{_ids(ids)}" for name, ids in self.servos.items())
            raise FaultError(f"there is no servo {servo_id}{f' on bus {bus}' if bus else ''}; known servos: {known}")
        if len(found) > 1:
            raise FaultError(f"servo {servo_id} exists on several buses: set bus to one of {', '.join(found)}")
        return found[0]

    def require_bus(self, bus: str | None) -> None:
        """Raise FaultError if the bus does not exist. None means all buses."""
        if not self.servos:
            raise FaultError("servos cannot be selected here, because all servos of a box have the same ID")
        if bus is not None and bus not in self.servos:
            raise FaultError(f"there is no bus {bus!r}; known buses: {', '.join(map(repr, self.servos))}")

    def buses(self, bus: str | None) -> list[str]:
        """Return the names of the buses that ``bus`` refers to."""
        return list(self.servos) if bus is None else [bus]


def _ids(servos: Mapping[int, ServoModel]) -> str:
    return ", ".join(map(str, servos))


@dataclass(frozen=True, slots=True)
class FaultPlace:
    """Position of a servo as it was mounted, regardless of its current ID."""

    line: ServoLine[Any]
    number: int
    """Index of the servo on the bus."""

    @property
    def servo(self) -> Any:
        return self.line.servos[self.number]

    @property
    def joint(self) -> str:
        return self.line.rig.plant.couplings[self.number].joint

    @property
    def ratio(self) -> float:
        """Signed joint displacement per radian of shaft rotation."""
        return self.line.rig.plant.couplings[self.number].ratio


@dataclass(slots=True)
class FaultTargets:
    """Targets of faults. Servos are identified by the IDs that they had when they were mounted."""

    lines: Mapping[str, ServoLine[Any]]
    world: Mechanics | None = None
    adapters: Mapping[str, FaultyAdapter] = field(default_factory=dict)
    stack: StackTarget | None = None
    holds: Holds = field(default_factory=Holds)
    _each_step: list[Callable[[float], None]] = field(default_factory=list)

    @property
    def inventory(self) -> Inventory:
        """Description of these targets."""
        servos = {
            name: {
                coupling.servo_id: servo.model
                for coupling, servo in zip(line.rig.plant.couplings, line.servos, strict=True)
            }
            for name, line in self.lines.items()
        }
        controllers = self.stack.controllers if self.stack is not None else {}
        return Inventory(servos, self.world is not None, bool(self.adapters), self.stack is not None, controllers)

    def place(self, servo_id: int, bus: str | None) -> FaultPlace:
        """Return the position of a servo."""
        line = self.lines[self.inventory.bus_of(servo_id, bus)]
        ids = [coupling.servo_id for coupling in line.rig.plant.couplings]
        return FaultPlace(line, ids.index(servo_id))

    def lines_of(self, bus: str | None) -> list[ServoLine[Any]]:
        """Return one bus, or all buses."""
        return [self.lines[name] for name in self.inventory.buses(bus)]

    @contextmanager
    def each_step(self, act: Callable[[float], None]) -> Iterator[None]:
        """While the context is active, call ``act(time_s)`` after each step of the world."""
        self._each_step.append(act)
        try:
            yield
        finally:
            self._each_step.remove(act)

    def step(self, time_s: float) -> None:
        """Report that a step of the world is complete."""
        for act in self._each_step:
            act(time_s)
