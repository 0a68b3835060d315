"""What must hold whatever happens to an arm: small classes that look on while a simulated stack runs."""

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from controller.trajectory.goal import GoalHandle
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointState
from servoloop.campaign.wire_monitor import WireMonitor
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.bus import VirtualBus
from sim_backend.faults.event import Event

CYCLES_TO_NAME: Final = 2
"""In so many cycles a servo that is not heard is named."""
FOUND_S: Final = 0.5
"""Torque that a servo lost without a word is found within this time at 20 Hz."""
UNHEARD: Final = ("silent", "brown_out")
"""Faults of one servo, which then does not answer; the others have nothing to do with them."""
ROUNDING: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Violation:
    """An invariant that fell, when (s of the stack's clock), and how."""

    invariant: str
    time_s: float
    text: str


class Invariant:
    """What looks on at one stack; a subclass overrides what it has a use for, and ``say``\\ s what must not be."""

    name = ""

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        self.stack = stack
        self.say = say
        self.joints = stack.files.robot.joints

    @property
    def active(self) -> bool:
        """Whether the hardware drives its joints."""
        return self.stack.loop.hardware.state is LifecycleState.ACTIVE

    def torque(self, joint: Joint) -> bool:
        """Whether the joint's servo drives its motor, as it is and not as the stack knows it."""
        servo = self.stack.player.targets.place(joint.servo_id, joint.bus).servo
        return bool(servo.memory.get(series_of(joint.model).torque_enable) != 0)

    def on_write(self, bus: str, data: bytes) -> None:
        """Called with every packet, before the servos of this line hear it."""

    def on_state(self, state: JointState) -> None:
        """Called with each cycle's measurement."""

    def at_end(self) -> None:
        """Called when the program has ended and the hardware is released."""


class SafeWire(Invariant):
    """No goal outside the limits, none that leaps, and torque only with the goal at the measured position.

    Read along on the wire of Feetech servos, whatever the layers above believe to have sent.
    """

    name = "safe wire"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._monitors = {
            name: WireMonitor(tuple(j for j in self.joints if j.bus == name), line, stack.loop.period_s)
            for name, line in stack.lines.items()
            if isinstance(line, VirtualBus)
        }

    def on_write(self, bus: str, data: bytes) -> None:
        if monitor := self._monitors.get(bus):
            told = len(monitor.broken)
            monitor.see(data)
            for text in monitor.broken[told:]:
                self.say(text)


class SafeCommands(Invariant):
    """What passed the gate is finite, within the limits, and no further from the last than velocity times period.

    The layers below hold some of this as well: they must not be needed. No NaN is reported either.
    """

    name = "safe commands"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._last: FloatArray | None = None
        limits = stack.loop.limits
        self._lower, self._upper = np.array([one.lower for one in limits]), np.array([one.upper for one in limits])
        self._reach = np.array([one.velocity for one in limits]) * stack.loop.period_s

    def on_state(self, state: JointState) -> None:
        if not all(map(math.isfinite, (*state.position, *state.velocity))):
            self.say("a position or a velocity that is reported is no number")
        command = self.stack.loop.command
        last, self._last = self._last, command.copy() if self.active else None
        if not self.active:
            return
        if not np.isfinite(command).all():
            self.say("the loop commands what is no number")
        # A joint that stood outside its limits when it was switched on may be on its way back.
        before = command if last is None else last
        outside = np.maximum(self._lower - command, command - self._upper)
        was_outside = np.maximum(self._lower - before, before - self._upper)
        if (outside > np.maximum(was_outside, 0.0) + ROUNDING).any():
            self.say(f"commands beyond the limits: {command.round(4).tolist()}")
        if last is not None and (np.abs(command - last) > self._reach + ROUNDING).any():
            self.say(f"commands leap within a cycle from {last.round(4).tolist()} to {command.round(4).tolist()}")


class NamedAlone(Invariant):
    """A servo that is not heard is named within two cycles, and as long as nothing else is wrong it alone."""

    name = "named, and it alone"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._unnamed, self._misnamed = Counter[str](), Counter[str]()
        self._events: list[tuple[float, Any]] = []
        play = stack.player.play

        def noted(events: Iterable[Event], since_s: float = 0.0) -> None:
            events = tuple(events)
            play(events, since_s)
            self._events += [(since_s + event.at_s, event) for event in events]

        stack.player.play = noted  # type: ignore[method-assign]

    def on_state(self, state: JointState) -> None:
        begun = [event for at_s, event in self._events if at_s <= self.stack.world.time_s]
        if not self.active or any(event.kind not in UNHEARD for event in begun):
            return
        silent = {self._joint(one) for one in self.stack.player.active.values()}
        concerned = {self._joint(event) for event in begun}
        self._unnamed = Counter({joint: self._unnamed[joint] + 1 for joint in silent - state.faults.keys()})
        self._misnamed = Counter({joint: self._misnamed[joint] + 1 for joint in state.faults.keys() - concerned})
        for wrong, what in ((self._unnamed, "is silent, and nothing says so"), (self._misnamed, "is named, and well")):
            for joint, cycles in wrong.items():
                if cycles > CYCLES_TO_NAME:
                    self.say(f"{joint} {what}, for {cycles} cycles")

    def _joint(self, event: Any) -> str:
        return next(j.name for j in self.joints if j.servo_id == event.servo_id and event.bus in (None, j.bus))


class NoGoalWhileLimp(Invariant):
    """A servo that lost its torque is found within half a second: a goal would switch it on where it stands."""

    name = "limp joints are found"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._limp_since_s: dict[str, float] = {}

    def on_state(self, state: JointState) -> None:
        for joint in self.joints:
            known = not self.active or joint.name in state.faults or self.stack.player.active
            if known or self.torque(joint):
                self._limp_since_s.pop(joint.name, None)
                continue
            limp_s = state.stamp_s - self._limp_since_s.setdefault(joint.name, state.stamp_s)
            if limp_s > FOUND_S + 2.0 * self.stack.loop.period_s:
                self.say(f"{joint.name} is limp for {limp_s:.2f} s, and nothing says so")


class GoalsEnd(Invariant):
    """Every goal that was taken has an end."""

    name = "every goal ends"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._goals: list[GoalHandle] = []

    def on_state(self, state: JointState) -> None:
        newest = self.stack.controllers[self.stack.arm.name].newest
        if newest is not None and (not self._goals or self._goals[-1] is not newest):
            self._goals.append(newest)

    def at_end(self) -> None:
        open_ones = [str(number) for number, goal in enumerate(self._goals, 1) if not goal.done]
        if open_ones:
            self.say(f"of {len(self._goals)} goals these have no end: {', '.join(open_ones)}")


class LimpAtTheEnd(Invariant):
    """Where the robot file says relax, no servo that can be reached has torque at the end."""

    name = "limp at the end"

    def at_end(self) -> None:
        if self.stack.player.active or self.stack.files.robot.file.on_exit.virtual != "relax":
            return
        if on := [joint.name for joint in self.joints if self.torque(joint)]:
            self.say(f"under torque: {', '.join(on)}")


ALL: Final[tuple[type[Invariant], ...]] = (SafeWire, SafeCommands, NamedAlone, NoGoalWhileLimp, GoalsEnd, LimpAtTheEnd)


class Watch:
    """Has invariants look on at a stack that is not up yet; ``violations``: the first of each that fell."""

    def __init__(self, stack: FaultyStack, kinds: tuple[type[Invariant], ...] = ALL) -> None:
        self.violations: dict[str, Violation] = {}
        self._stack = stack
        self._invariants = [kind(stack, self._sayer(kind.name)) for kind in kinds]
        former = stack.on_state
        for name, port in stack.ports.items():
            port.on_write = self._reader(name)

        def on_state(state: JointState) -> None:
            former(state)
            for one in self._invariants:
                one.on_state(state)

        stack.on_state = on_state

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
