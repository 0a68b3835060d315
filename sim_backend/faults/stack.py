"""Faults above the servos: faults of the computer that runs the stack, of a controller, or of a client."""

from collections.abc import Iterator
from contextlib import contextmanager
from random import Random
from typing import Any, ClassVar, Literal

from hal.plausible import Duration, Position, Seed
from sim_backend.faults.event import Event, Lasting, Momentary
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.tails import either_way, log_uniform
from sim_backend.faults.targets import ClientFault, ControllerFault, FaultTargets, Inventory, StackTarget


class _OfStack(Event):
    """A fault that requires a whole stack in simulated time."""

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        if not there.stack:
            raise FaultError(f"there is no stack here, only servos: {self.kind!r} requires a stack in simulated time")

    def stack(self, targets: FaultTargets) -> StackTarget:
        assert targets.stack is not None, "``refuse`` has checked this"
        return targets.stack


class LoopStall(_OfStack):
    """The computer stalls, as if another program used the processor. Cycles are missed, but the world continues to
    run."""

    kind: Literal["stall"] = "stall"
    for_s: Duration

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        self.stack(targets).stall(self.for_s)
        yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {"for_s": log_uniform(random, 0.001, 5.0)}


class _OfController(_OfStack, Lasting):
    """A fault that disturbs a controller in each cycle."""

    HOW: ClassVar[ControllerFault]
    controller: str | None = None
    """Name of the controller; None for the arm's controller."""

    def refuse(self, there: Inventory) -> None:
        super().refuse(there)
        if self.controller is None or not there.controllers:
            return
        if self.controller not in there.controllers:
            raise FaultError(
                f"there is no controller {self.controller!r}; known controllers: {', '.join(there.controllers)}"
            )
        able = self._able(there)
        if self.controller not in able:
            which = f"specify one of {', '.join(able)}" if able else "no controller of this stack commands joints"
            raise FaultError(f"{self.controller} commands no joints: {which}")

    @classmethod
    def _able(cls, there: Inventory) -> list[str]:
        """Return the controllers that can have this fault: all controllers for an exception, otherwise those that
        command joints."""
        return [name for name, commands in there.controllers.items() if commands or cls.HOW == "raises"]

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        with self.stack(targets).disturb_controller(self.controller, self.HOW, self._jump):
            yield

    @property
    def _jump(self) -> float:
        return 0.0

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "controller": random.choice(cls._able(there) or [None])}


class ControllerRaises(_OfController):
    """A controller raises an exception."""

    kind: Literal["controller_raises"] = "controller_raises"
    HOW = "raises"


class ControllerNan(_OfController):
    """A controller commands NaN or infinity to its joints, as after a division by zero."""

    kind: Literal["controller_nan"] = "controller_nan"
    HOW = "nan"
    value: Literal["nan", "inf", "-inf"] = "nan"

    @property
    def _jump(self) -> float:
        return float(self.value)

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "value": random.choice(["nan", "inf", "-inf"])}


class ControllerJumps(_OfController):
    """An offset ``by_rad``, in rad, is added to each command of a controller."""

    kind: Literal["controller_jumps"] = "controller_jumps"
    HOW = "jumps"
    by_rad: Position = 1.0

    @property
    def _jump(self) -> float:
        return self.by_rad

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {
            **super().draw_parameters(random, there),
            "by_rad": either_way(random, log_uniform(random, 0.001, 100.0)),
        }


class _OfClient(Momentary, _OfStack):
    """A client of the stack misbehaves."""

    DOES: ClassVar[ClientFault]
    seed: Seed = 0

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        self.stack(targets).disturb_client(self.DOES, self.stream())
        yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {"seed": random.randrange(1 << 16)}


class ClientNonsense(_OfClient):
    """A client sends an invalid goal, for example with NaN, with joints that do not exist, or with positions beyond the
    limits."""

    kind: Literal["client_nonsense"] = "client_nonsense"
    DOES = "nonsense"


class ClientCancels(_OfClient):
    """A client cancels its running goal."""

    kind: Literal["client_cancels"] = "client_cancels"
    DOES = "cancels"


class ClientDies(_OfClient):
    """A client dies. Its goal continues to run, but the client does not send another goal."""

    kind: Literal["client_dies"] = "client_dies"
    DOES = "dies"
