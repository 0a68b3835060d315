"""Clients of a simulated stack: what they do is drawn or written down beforehand, and is done between two cycles."""

import logging
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from controller.manager.switch import ManagerError, SwitchRequest
from controller.motion import Kinematics, MotionError, motion_to
from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from drivers.errors import DriverError
from hal.errors import HalError
from hal.lifecycle import LifecycleState
from hal.plausible import Chance, Duration, Position, Time, VelocityScale
from hal.types import JointLimits
from servoloop.simulation.stack import SimulatedStack

LOG = logging.getLogger("servoloop")

TABLE_S: Final = 0.1
"""Time between two points of a planner's trajectory."""
AHEAD_S: Final = 0.2
"""Time that a streaming client gives the arm to reach each point."""
SHORTEST_WAY_S: Final = 0.3
"""Shortest duration of a drawn move."""


class _Act(BaseModel):
    """One deed of a client, ``at_s`` seconds after the arm is up."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    at_s: Time = 0.0


class Move(_Act):
    """A goal with one point for all joints, as the pick-and-place node sends it."""

    kind: Literal["move"] = "move"
    positions: dict[str, Position]
    seconds: Duration = 2.0


class Plan(_Act):
    """A goal as planners send it: a table of positions, velocities and accelerations from where the arm is."""

    kind: Literal["plan"] = "plan"
    positions: dict[str, Position]
    scale: VelocityScale = 1.0
    """Share of the velocity limits that the planner uses."""


class Stream(_Act):
    """Points on the controller's topic, one in each second cycle, on the straight way to ``positions``."""

    kind: Literal["stream"] = "stream"
    positions: dict[str, Position]
    for_s: Duration = 1.0


class Cancel(_Act):
    """The newest goal is canceled."""

    kind: Literal["cancel"] = "cancel"


class Hand(_Act):
    """A command for the hand; ``share`` 0 is its lower limit and 1 its upper limit."""

    kind: Literal["hand"] = "hand"
    share: Chance = 0.5


class Switch(_Act):
    """The arm's controller is deactivated, and activated again after ``for_s``."""

    kind: Literal["switch"] = "switch"
    for_s: Duration = 0.5


class Reactivate(_Act):
    """The hardware is deactivated with its torque on, and activated again after ``for_s``; then the controllers."""

    kind: Literal["reactivate"] = "reactivate"
    for_s: Duration = 0.5


Act = Annotated[Move | Plan | Stream | Cancel | Hand | Switch | Reactivate, Field(discriminator="kind")]


class SimulatedClients:
    """Carries out ``acts`` on a stack that is up; ``cycle`` belongs behind every cycle."""

    def __init__(self, stack: SimulatedStack, arm: Any, acts: tuple[Act, ...]) -> None:
        """``arm``: the trajectory controller that goals go to."""
        self._stack, self._arm = stack, arm
        self._since_s = stack.clock.now()
        self._due: list[tuple[float, Callable[[], None]]] = [(act.at_s, self._deed(act)) for act in acts]
        self._due.sort(key=lambda one: one[0])
        self._streams: list[Iterator[None]] = []
        self.newest = ""
        """The kind of the newest act; empty before the first."""

    def cycle(self) -> None:
        """Do what is due."""
        now_s = self._stack.clock.now() - self._since_s
        while self._due and self._due[0][0] <= now_s:
            self._due.pop(0)[1]()
        self._streams = [stream for stream in self._streams if next(stream, self) is not self]

    def die(self) -> None:
        """No client does anything any more."""
        self._due.clear()
        self._streams.clear()

    def _deed(self, act: Act) -> Callable[[], None]:
        doers: Mapping[str, Callable[[Any], None]] = {
            "move": self._move,
            "plan": self._plan,
            "stream": self._stream,
            "cancel": self._cancel,
            "hand": self._hand,
            "switch": self._switch,
            "reactivate": self._reactivate,
        }

        def do() -> None:
            self.newest = act.kind
            try:
                doers[act.kind](act)
            except (DriverError, HalError, ManagerError, MotionError) as error:
                LOG.info("a client is refused: %s", error)

        return do

    def _later(self, after_s: float, deed: Callable[[], None]) -> None:
        self._due.append((self._stack.clock.now() - self._since_s + after_s, deed))
        self._due.sort(key=lambda one: one[0])

    def _move(self, act: Move) -> None:
        self._send(TrajectoryGoal(self._arm.joints, (GoalPoint(self._all(act.positions), act.seconds),)))

    def _plan(self, act: Plan) -> None:
        limits = [_scaled(limit, act.scale) for limit in self._limits()]
        here = np.clip(self._here(), [one.lower for one in limits], [one.upper for one in limits])
        way = motion_to(Kinematics.at_rest(here), Kinematics.at_rest(np.array(self._all(act.positions))), limits, 0.0)
        times_s = [*np.arange(TABLE_S, way.duration_s, TABLE_S).tolist(), max(way.duration_s, TABLE_S / 2.0)]
        self._send(TrajectoryGoal(self._arm.joints, tuple(_point(way.sample(time_s), time_s) for time_s in times_s)))

    def _stream(self, act: Stream) -> None:
        self._streams.append(self._points(act))

    def _points(self, act: Stream) -> Iterator[None]:
        start, goal = self._here(), np.array(self._all(act.positions))
        begun_s = self._stack.clock.now()
        while (share := (self._stack.clock.now() - begun_s + AHEAD_S) / (act.for_s + AHEAD_S)) < 1.0:
            point = GoalPoint(tuple((start + share * (goal - start)).tolist()), AHEAD_S)
            self._send(TrajectoryGoal(self._arm.joints, (point,), from_topic=True))
            yield
            yield

    def _cancel(self, act: Cancel) -> None:
        if self._arm.newest is not None:
            self._arm.cancel(self._arm.newest)

    def _hand(self, act: Hand) -> None:
        limit = self._limit_of(self._stack.hand.joints[0])
        self._stack.hand.submit([limit.lower + act.share * (limit.upper - limit.lower)])

    def _switch(self, act: Switch) -> None:
        name, loop = self._arm.name, self._stack.loop
        loop.manager.switch(SwitchRequest(deactivate=(name,)), loop.within_limits)
        self._later(act.for_s, lambda: self._activate(name))

    def _activate(self, *names: str) -> None:
        loop = self._stack.loop
        for name in names:
            try:
                loop.manager.switch(SwitchRequest(activate=(name,)), loop.within_limits)
            except ManagerError as error:
                LOG.info("a client is refused: %s", error)

    def _reactivate(self, act: Reactivate) -> None:
        loop = self._stack.loop
        running = [one.spec.name for one in loop.manager.registry.running if one.controller.command_interfaces]
        transitions, components = loop.component_transitions, [one.name for one in loop.hardware.components]
        for name in components:
            transitions.ask(name, LifecycleState.INACTIVE)

        def activate() -> None:
            for name in components:
                transitions.ask(name, LifecycleState.ACTIVE)
            self._later(2.0 * loop.period_s, lambda: self._activate(*running))

        self._later(act.for_s, activate)

    def _send(self, goal: TrajectoryGoal) -> None:
        if self._arm.check(goal) is None:
            self._arm.submit(goal)

    def _here(self) -> Any:
        """The commands of the arm's joints (n,), rad or m: a planner begins where it has sent the arm."""
        loop = self._stack.loop
        return loop.command[[self._names().index(joint) for joint in self._arm.joints]]

    def _all(self, positions: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(positions.get(name, here) for name, here in zip(self._arm.joints, self._here(), strict=True))

    def _names(self) -> list[str]:
        return [name.rpartition("/")[0] for name in self._stack.loop.hardware.command_interfaces]

    def _limit_of(self, joint: str) -> JointLimits:
        return self._stack.loop.limits[self._names().index(joint)]

    def _limits(self) -> list[JointLimits]:
        return [self._limit_of(joint) for joint in self._arm.joints]


def _point(state: Kinematics, time_s: float) -> GoalPoint:
    return GoalPoint(
        tuple(state.position.tolist()), time_s, tuple(state.velocity.tolist()), tuple(state.acceleration.tolist())
    )


def _scaled(limit: JointLimits, scale: float) -> JointLimits:
    return JointLimits(limit.lower, limit.upper, limit.velocity * scale, limit.acceleration, limit.jerk)
