"""Resume a trajectory from rest after a bus stall, which leaves the joints at rest at their last command."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.motion import Kinematics, Path
from controller.trajectory.execution import GoalExecution
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.paths import NEAR
from controller.trajectory.sampler import TrajectorySampler, shorter_way
from controller.unmeasured import Unmeasured
from hal.types import FloatArray, JointFault

LONGEST_LEAD_S: Final = 0.5
"""Maximum time ahead of the reference in which to search for the path point nearest to the last command, in seconds.

This time covers the lag of the servos and one period.
"""
SAMPLES: Final = 30
"""Number of instants that the search samples. A finer search around the best instant samples the same number of
instants."""
REJOIN_S: Final = 0.3
"""Time on the path within which joints that start beside the path return to it, in seconds."""


class Standstill(Unmeasured):
    """Standstill of one trajectory during a bus stall, handled in the loop thread.

    Call ``step`` in cycles with faults and in the following cycles, until ``cycles`` is 0.
    """

    def __init__(
        self, joints: Sequence[str], endless: Sequence[int], sampler: TrajectorySampler, execution: GoalExecution
    ) -> None:
        super().__init__(joints)
        self._endless, self._sampler, self._execution = endless, sampler, execution

    def step(
        self,
        faults: Mapping[str, JointFault],
        step_s: float,
        sent: FloatArray,
        measured: FloatArray,
        parameters: TrajectoryParameters,
    ) -> float:
        """Return the time by which the trajectory advances, in seconds. ``sent`` is the last command (n,)."""
        sampler, waited = self._sampler, self.waits
        ahead = shorter_way(sent - measured, self._endless)
        step_s = self.step_s(faults, step_s, lambda: bool((np.abs(ahead) <= NEAR).all()))
        if self.waits and not waited:
            if sampler.on_goal:
                restart(sampler, sent, parameters.command_lead or 0.0)
            else:
                sampler.hold(sent)  # A trajectory that was already stopping is not resumed.
        return step_s


def restart(sampler: TrajectorySampler, sent: FloatArray, lead_s: float = 0.0) -> None:
    """Resume the path from rest at the last command ``sent`` (n,), which led the path by the lag of each joint."""
    assert sampler.path is not None, "the controller is updated before it is activated"
    path, now_s = sampler.path, sampler.elapsed_s
    while isinstance(path, OffsetPath) and now_s >= path.from_s + REJOIN_S:
        path = path.path
    window_s = (LONGEST_LEAD_S + lead_s) * sampler.rate
    about_s = _nearest_s(path, sent, now_s, now_s + window_s)
    from_s = _nearest_s(path, sent, max(about_s - window_s / SAMPLES, now_s), about_s + window_s / SAMPLES)
    offset = sent - path.sample(from_s).position
    sampler.resume(OffsetPath(path, offset, from_s) if offset.any() else path, from_s)


def _nearest_s(path: Path, position: FloatArray, first_s: float, last_s: float) -> float:
    """Return the time at which the path is first closest to a position (n,)."""
    nearest_s, least = first_s, np.inf
    for time_s in np.linspace(first_s, last_s, SAMPLES + 1).tolist():
        off = float(np.linalg.norm(path.sample(time_s).position - position))
        if off > least:
            break
        if off < least:
            nearest_s, least = time_s, off
    return nearest_s


@dataclass(frozen=True, slots=True)
class OffsetPath:
    """A path that starts at ``from_s`` with an ``offset`` (n,) from another path and soon rejoins it."""

    path: Path
    offset: FloatArray
    from_s: float

    @property
    def duration_s(self) -> float:
        """Time at which the joints have rejoined the path and the path has ended, in seconds."""
        return max(self.path.duration_s, self.from_s + REJOIN_S)

    @property
    def asked_s(self) -> float:
        """Requested duration, in seconds. Rejoining the path does not count as stretching."""
        return self.path.asked_s + self.duration_s - self.path.duration_s

    def sample(self, time_s: float) -> Kinematics:
        """Return the kinematics at ``time_s`` after the start."""
        state, u = self.path.sample(time_s), max((time_s - self.from_s) / REJOIN_S, 0.0)
        if u >= 1.0:
            return state
        return Kinematics(
            state.position + self.offset * (1.0 - u**2 * (3.0 - 2.0 * u)),
            state.velocity - self.offset * (6.0 * u * (1.0 - u) / REJOIN_S),
            state.acceleration - self.offset * (6.0 * (1.0 - 2.0 * u) / REJOIN_S**2),
        )
