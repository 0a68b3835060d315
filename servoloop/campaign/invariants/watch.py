"""The list of all invariants, and the watch that calls them during a run."""

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.commands.goal_positions import GoalsMeanCommands
from servoloop.campaign.invariants.commands.offsets import OffsetsCarryTheWeight
from servoloop.campaign.invariants.commands.safety import SafeCommands, SafeWire
from servoloop.campaign.invariants.commands.wire_monitor import GoalReader
from servoloop.campaign.invariants.goals.ends import CancelsAreFollowed, GoalsAreJudged, GoalsEnd
from servoloop.campaign.invariants.goals.first_reason import FirstReasonDecides
from servoloop.campaign.invariants.goals.forwarded import ForwardedIsFollowed
from servoloop.campaign.invariants.goals.grips import GripsAreFollowed
from servoloop.campaign.invariants.goals.paths import (
    PathIsAsSent,
    ReplacedGoalsEnd,
    StopsFollowPaths,
)
from servoloop.campaign.invariants.goals.programs import ProgramsAreInformed, StreamsAreFollowed
from servoloop.campaign.invariants.goals.results import AbortsAreTrue, DeviationEnds, FeedbackIsTrue, SuccessIsTrue
from servoloop.campaign.invariants.goals.scaling import SpeedScalingIsFollowed
from servoloop.campaign.invariants.goals.waiting import TrajectoriesWait
from servoloop.campaign.invariants.invariant import Invariant, Violation
from servoloop.campaign.invariants.lifecycle.activation import ActivatedAsConfigured
from servoloop.campaign.invariants.lifecycle.end import EndsAsChosen
from servoloop.campaign.invariants.lifecycle.resumption import ControllersResume
from servoloop.campaign.invariants.motion.guided import GuidedJointsYield
from servoloop.campaign.invariants.motion.presses import LongPressesAreReduced
from servoloop.campaign.invariants.motion.rest import NothingPresses, NothingTravels
from servoloop.campaign.invariants.motion.smoothness import NanHolds, SmoothEnd, SmoothReference
from servoloop.campaign.invariants.motion.speed import NoFasterThanAllowed
from servoloop.campaign.invariants.reports.positions import ReportedTruly
from servoloop.campaign.invariants.reports.published import PublishedAsMeasured
from servoloop.campaign.invariants.reports.sensors import HealthIsTrue, MotionIsTrue
from servoloop.campaign.invariants.reports.servos import LimpIsFound, MeasuredNow, NamedAlone, TakenBack
from servoloop.campaign.visits import Visits
from servoloop.simulation.faulty_stack import FaultyStack

ALL: Final[tuple[type[Invariant], ...]] = (
    SafeWire,
    SafeCommands,
    NoFasterThanAllowed,
    GoalsMeanCommands,
    OffsetsCarryTheWeight,
    ReportedTruly,
    MotionIsTrue,
    HealthIsTrue,
    PublishedAsMeasured,
    SuccessIsTrue,
    PathIsAsSent,
    ForwardedIsFollowed,
    MeasuredNow,
    NamedAlone,
    TakenBack,
    LimpIsFound,
    GoalsEnd,
    TrajectoriesWait,
    SpeedScalingIsFollowed,
    ReplacedGoalsEnd,
    DeviationEnds,
    AbortsAreTrue,
    FirstReasonDecides,
    CancelsAreFollowed,
    StopsFollowPaths,
    FeedbackIsTrue,
    GoalsAreJudged,
    ProgramsAreInformed,
    StreamsAreFollowed,
    GripsAreFollowed,
    NothingTravels,
    NothingPresses,
    LongPressesAreReduced,
    GuidedJointsYield,
    SmoothReference,
    SmoothEnd,
    NanHolds,
    ActivatedAsConfigured,
    ControllersResume,
    EndsAsChosen,
)


class Watch:
    """Watch that connects invariants to a stack that has not been started yet, and collects the first violation of each
    invariant.

    Args:
        stack: The stack, before it is up.
        kinds: Classes of the invariants.
    """

    def __init__(self, stack: FaultyStack, kinds: tuple[type[Invariant], ...] = ALL) -> None:
        self.violations: dict[str, Violation] = {}
        self._stack = stack
        self._error: Exception | None = None
        """Exception that an invariant raised. ``end`` raises it again."""
        self._invariants = [
            kind(stack, self._sayer(kind.name), arm)
            for kind in kinds
            for arm in (stack.arms if kind.of_each_arm else (stack.arm,))
        ]
        self.visits = Visits(stack)
        former_state, former_step = stack.on_state, stack.on_step
        on_step, on_write, on_goals = (self._guarded(hook) for hook in ("on_step", "on_write", "on_goals"))
        on_motion, on_state = self._guarded("on_motion"), self._guarded("on_state")
        positions: list[FloatArray] = []
        copy_positions, places = stack.world.arrays.position.copy, list(stack.world.arrays.position_at)

        def stepped(time_s: float) -> None:
            former_step(time_s)
            positions.append(copy_positions())  # of all bodies, because this is called every millisecond
            on_step(time_s)

        def measured(state: JointState) -> None:
            former_state(state)
            self.visits.update(state)
            on_motion(np.array(positions)[:, places] if positions else np.empty((0, len(places))))
            positions.clear()
            on_state(state)

        stack.components.on_command = self._guarded("on_command")
        stack.on_state, stack.on_step = measured, stepped
        joints = stack.files.robot.joints
        readers = {
            name: GoalReader(line, [joint for joint in joints if joint.bus == name])
            for name, line in stack.lines.items()
        }

        def written(bus: str, data: bytes) -> None:
            on_write(bus, data)
            if goals := readers[bus].read(data):
                on_goals(bus, goals)

        for name, port in stack.ports.items():
            port.on_write = partial(written, name)

    @property
    def examined(self) -> dict[str, int]:
        """Number of times that the condition of each invariant was checked, keyed by invariant name."""
        examined = Counter[str]()
        for one in self._invariants:
            examined[one.name] += one.examined
        return examined

    def end(self) -> None:
        """Finish all invariants after the program has ended.

        Raises the exception of an invariant that failed during the run.
        """
        if self._error is not None:
            raise self._error
        self.visits.end()
        for one in self._invariants:
            one.at_end()

    def _guarded(self, hook: str) -> Callable[..., None]:
        """Return a function that calls this method on all invariants and hides their exceptions from the stack."""
        kept = [one for one in self._invariants if getattr(type(one), hook) is not getattr(Invariant, hook)]
        hooks = [getattr(one, hook) for one in kept]

        def call(*arguments: Any) -> None:
            if self._error is None:
                try:
                    for one in hooks:
                        one(*arguments)
                except Exception as error:
                    self._error = error

        return call

    def _sayer(self, name: str) -> Callable[[str], None]:
        def say(text: str) -> None:
            self.violations.setdefault(name, Violation(name, round(self._stack.clock.now(), 4), text))

        return say
