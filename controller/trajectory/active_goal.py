"""Evaluate the active goal of a trajectory controller in each cycle."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.motion import Kinematics
from controller.trajectory.goal import GoalHandle
from controller.trajectory.goal_planner import Plan
from controller.trajectory.goal_result import GoalResult, path_violated
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.rest import HELD_S, LONGEST_REST_S, RESTS_S, Rest
from controller.trajectory.sampler import TrajectorySampler
from controller.trajectory.tolerances import Tolerances, excess
from hal.fault_timeout import FaultTimeout
from hal.types import FloatArray, JointState

NEAR: Final = 3.0
"""Maximum distance from the reference at which a joint counts as near, in multiples of the still threshold. A joint
that is further away may still be approaching its reference.
"""


@dataclass(frozen=True, slots=True)
class Cycle:
    """Data for one controller cycle. Arrays have shape (n,)."""

    state: JointState
    reference: Kinematics
    measured: FloatArray
    """Measured positions."""
    measured_before: FloatArray
    """Measured positions in the previous cycle."""
    velocity: FloatArray
    """Measured velocities."""
    error: FloatArray
    """Position error, which is the reference minus the measurement."""
    error_before: FloatArray
    """Position error in the previous cycle."""
    step_s: float
    period_s: float
    parameters: TrajectoryParameters
    tolerances: Tolerances
    """Default tolerances for goals that do not specify any."""
    waits: bool
    """Whether the trajectory is waiting for joints that are not measured or are still moving to a late command."""

    @property
    def confirmed(self) -> FloatArray:
        """Median (n,) of this reading, the previous reading and the reference.

        The median rejects a single wrong reading.
        """
        position: FloatArray = np.median([self.measured, self.measured_before, self.reference.position], axis=0)
        return position

    @property
    def confirmed_error(self) -> FloatArray:
        """The smaller error (n,) of this reading and the previous reading, because one of the readings may be wrong.

        If the two errors have opposite signs, the result is 0.
        """
        agree = self.error * self.error_before > 0.0
        smaller = np.sign(self.error) * np.minimum(np.abs(self.error), np.abs(self.error_before))
        error: FloatArray = np.where(agree, smaller, 0.0)
        return error


@dataclass(slots=True)
class ActiveGoal:
    """The active goal, which waits for other controllers until ``begun`` is True."""

    handle: GoalHandle
    plan: Plan
    tolerances: Tolerances
    fault_timeout: FaultTimeout
    waited_s: float
    """Time since the cycle for which the goal was planned, in seconds."""
    begun: bool = False
    recall_s: float = 0.0
    """Remaining time in which the started goal can still be put back into the waiting state, in seconds."""
    ending: GoalResult | None = None
    """Result to report when the joints have come to rest."""
    rest: Rest | None = None
    """Rest detector for joints within the goal tolerance. None until the joints are within the tolerance."""
    near_s: float = 0.0
    """Time for which the joints have been within the goal tolerance, in seconds."""

    def settles(self, now: Cycle, still: FloatArray) -> bool:
        """Return whether joints within the goal tolerance are at rest, or have had enough time to come to rest.

        ``still`` (n,) is the largest change in position that does not count as motion. The next goal is planned from
        the measured positions. Joints that follow exactly are at rest as soon as their reference is at rest.
        """
        self.rest = self.rest or Rest(still)
        self.rest.update(now.measured, now.step_s)
        self.near_s += now.step_s
        near = np.abs(now.error) <= NEAR * still
        follows = np.maximum(np.abs(now.error), np.abs(now.error_before)) <= still
        rests = self.rest.for_at_least(np.where(near, RESTS_S, HELD_S)) | follows
        return bool(rests.all()) or self.near_s > LONGEST_REST_S

    def off_path(self, joints: Sequence[str], now: Cycle) -> GoalResult | None:
        """Return the result if a joint is further from the path than its servo may lag, or None otherwise.

        A servo at full power may fall behind a fast path, but its joint moves along the path. A blocked joint does not
        move, so the tolerance for joints at rest is used for it.
        """
        wanted, moves, lag_time_s = now.reference.velocity, now.velocity, self.tolerances.lag_time_s
        along = np.where(wanted * moves > 0.0, np.minimum(np.abs(wanted), np.abs(moves)), 0.0)
        lags = {name: v * lag_time_s.get(name, 0.0) for name, v in zip(joints, along.tolist(), strict=True)}
        allowed = {name: at_rest and at_rest + lags[name] for name, at_rest in self.tolerances.path.items()}
        off = excess(joints, now.confirmed_error, allowed, now.state.faults)
        return path_violated(off) if off else None


def commands_timed_out(sampler: TrajectorySampler, parameters: TrajectoryParameters) -> bool:
    """Return whether no new command has arrived within ``cmd_timeout``, as in ros2_control."""
    allowed_s, path = parameters.cmd_timeout, sampler.path
    if path is None or not sampler.on_goal or allowed_s <= parameters.constraints.goal_time:
        return False
    return sampler.elapsed_s - path.duration_s > allowed_s
