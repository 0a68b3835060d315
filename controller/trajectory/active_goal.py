"""The goal under way, and the cycle in which it is looked at."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.fault_timeout import FaultTimeout
from controller.motion import Kinematics
from controller.trajectory.goal import GoalHandle
from controller.trajectory.goal_planner import Plan
from controller.trajectory.goal_result import GoalResult, path_violated
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.rest import HELD_S, LONGEST_REST_S, RESTS_S, Rest
from controller.trajectory.sampler import TrajectorySampler
from controller.trajectory.tolerances import Tolerances, excess
from hal.types import FloatArray, JointState

NEAR: Final = 3.0
"""A joint that is further from its reference than so many times what counts as no motion may still come nearer."""


@dataclass(frozen=True, slots=True)
class Cycle:
    """One cycle of the controller; arrays (n,), ``error`` is the reference less what was measured."""

    state: JointState
    reference: Kinematics
    measured: FloatArray
    measured_before: FloatArray
    """In the cycle before."""
    velocity: FloatArray
    """As measured."""
    error: FloatArray
    error_before: FloatArray
    """The error of the cycle before."""
    step_s: float
    period_s: float
    parameters: TrajectoryParameters
    tolerances: Tolerances
    """The defaults for goals that bring none."""
    waits: bool
    """The joints stand: they have not been measured, or are on their way to a command that came late."""

    @property
    def confirmed(self) -> FloatArray:
        """The measured positions (n,), as far as this reading and the one before it agree on them."""
        position: FloatArray = np.median([self.measured, self.measured_before, self.reference.position], axis=0)
        return position

    @property
    def confirmed_error(self) -> FloatArray:
        """The part of the error (n,) that this reading and the one before it agree on: one of them may be false."""
        agree = self.error * self.error_before > 0.0
        smaller = np.sign(self.error) * np.minimum(np.abs(self.error), np.abs(self.error_before))
        error: FloatArray = np.where(agree, smaller, 0.0)
        return error


@dataclass(slots=True)
class ActiveGoal:
    """The goal under way; until it has ``begun`` it waits for other controllers."""

    handle: GoalHandle
    plan: Plan
    tolerances: Tolerances
    fault_timeout: FaultTimeout
    waited_s: float
    """Seconds since the cycle for which the goal was planned."""
    begun: bool = False
    recall_s: float = 0.0
    """Seconds for which the goal can still be made to wait."""
    ending: GoalResult | None = None
    """How the goal ends once the joints rest."""
    rest: Rest | None = None
    """The rest of joints that are within the goal tolerance; None before."""
    near_s: float = 0.0
    """Seconds for which they have been within it."""

    def settles(self, now: Cycle, still: FloatArray) -> bool:
        """Whether joints within the goal tolerance rest, or have had their time to; ``still`` (n,) is no motion.

        The next plan begins where they are measured now. Joints that follow exactly rest when their reference does.
        """
        self.rest = self.rest or Rest(still)
        self.rest.look(now.measured, now.step_s)
        self.near_s += now.step_s
        near = np.abs(now.error) <= NEAR * still
        follows = np.maximum(np.abs(now.error), np.abs(now.error_before)) <= still
        rests = self.rest.for_at_least(np.where(near, RESTS_S, HELD_S)) | follows
        return bool(rests.all()) or self.near_s > LONGEST_REST_S

    def off_path(self, joints: Sequence[str], now: Cycle) -> GoalResult | None:
        """Return the result if a joint is further off the path than its servo lags; None if none is.

        A servo that drives with all it has falls behind a fast path, but its joint moves along. A blocked joint does
        not, and its tolerance is that of rest.
        """
        wanted, moves, lag_time_s = now.reference.velocity, now.velocity, self.tolerances.lag_time_s
        along = np.where(wanted * moves > 0.0, np.minimum(np.abs(wanted), np.abs(moves)), 0.0)
        lags = {name: v * lag_time_s.get(name, 0.0) for name, v in zip(joints, along.tolist(), strict=True)}
        allowed = {name: at_rest and at_rest + lags[name] for name, at_rest in self.tolerances.path.items()}
        off = excess(joints, now.confirmed_error, allowed, now.state.faults)
        return path_violated(off) if off else None


def commands_timed_out(sampler: TrajectorySampler, parameters: TrajectoryParameters) -> bool:
    """Time without a new point after which the motion ends, as upstream."""
    allowed_s, path = parameters.cmd_timeout, sampler.path
    if path is None or not sampler.on_goal or allowed_s <= parameters.constraints.goal_time:
        return False
    return sampler.elapsed_s - path.duration_s > allowed_s
