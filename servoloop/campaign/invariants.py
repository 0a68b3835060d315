"""What must hold whatever happens to an arm: all invariants, and what has them look on at a stack."""

from collections.abc import Callable
from typing import Final

from hal.types import JointState
from servoloop.campaign.command_invariants import SafeCommands, SafeWire
from servoloop.campaign.end_invariants import EndsAsChosen, GoalsEnd
from servoloop.campaign.invariant import Invariant, Violation
from servoloop.campaign.motion_invariants import NoFasterThanAllowed
from servoloop.campaign.report_invariants import LimpIsFound, MeasuredNow, NamedAlone
from servoloop.simulation.faulty_stack import FaultyStack

__all__ = ["ALL", "Invariant", "Violation", "Watch"]

ALL: Final[tuple[type[Invariant], ...]] = (
    SafeWire,
    SafeCommands,
    NoFasterThanAllowed,
    MeasuredNow,
    NamedAlone,
    LimpIsFound,
    GoalsEnd,
    EndsAsChosen,
)


class Watch:
    """Has invariants look on at a stack that is not up yet; ``violations``: the first of each that fell."""

    def __init__(self, stack: FaultyStack, kinds: tuple[type[Invariant], ...] = ALL) -> None:
        self.violations: dict[str, Violation] = {}
        self._stack = stack
        self._invariants = [kind(stack, self._sayer(kind.name)) for kind in kinds]
        former, former_step = stack.on_state, stack.on_step
        on_steps = [one.on_step for one in self._invariants if type(one).on_step is not Invariant.on_step]
        for name, port in stack.ports.items():
            port.on_write = self._reader(name)

        def on_state(state: JointState) -> None:
            former(state)
            for one in self._invariants:
                one.on_state(state)

        def on_step(time_s: float) -> None:
            former_step(time_s)
            for look in on_steps:
                look(time_s)

        stack.on_state, stack.on_step = on_state, on_step

    def end(self) -> None:
        """The program has ended."""
        for one in self._invariants:
            one.at_end()

    def _reader(self, bus: str) -> Callable[[bytes], None]:
        def see(data: bytes) -> None:
            for one in self._invariants:
                one.on_write(bus, data)

        return see

    def _sayer(self, name: str) -> Callable[[str], None]:
        def say(text: str) -> None:
            self.violations.setdefault(name, Violation(name, round(self._stack.clock.now(), 4), text))

        return say
