"""Where the line stalls joints come to rest at the last command, and their trajectory goes on from there, from rest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.motion import Kinematics, Path
from controller.trajectory.execution import Execution
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.paths import NEAR
from controller.trajectory.sampler import TrajectorySampler, shorter_way
from controller.unmeasured import Unmeasured
from hal.types import FloatArray, JointFault

LONGEST_LEAD_S: Final = 0.5
"""So far ahead of a path's reference its point is looked for that is nearest to the last command: lag and a period."""
LOOKS: Final = 30
"""At so many instants of that time, and at as many again about the best one."""
BESIDE_S: Final = 0.3
"""Within so much of its own time joints that go on beside their path are back on it."""


class Standstill(Unmeasured):
    """The standstill of one trajectory, to be asked in cycles with faults, and behind them. In the loop's thread."""

    def __init__(
        self, joints: Sequence[str], endless: Sequence[int], sampler: TrajectorySampler, execution: Execution
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
        """The time (s) by which the trajectory moves on; ``sent`` is the last command (n,)."""
        sampler, waited = self._sampler, self.waits
        ahead = shorter_way(sent - measured, self._endless)
        step_s = self.step_s(faults, step_s, lambda: bool((np.abs(ahead) <= NEAR).all()))
        if self.waits and not waited:
            if sampler.on_goal:
                restart(sampler, sent, parameters.command_lead or 0.0)
            else:
                sampler.hold(sent)  # stopped is stopped
        return step_s


def restart(sampler: TrajectorySampler, sent: FloatArray, lead_s: float = 0.0) -> None:
    """Go on from rest at the last command ``sent`` (n,), which was ahead of the path, and by joint."""
    assert sampler.path is not None, "activated before the first update"
    path, now_s = sampler.path, sampler.elapsed_s
    while isinstance(path, Beside) and now_s >= path.from_s + BESIDE_S:
        path = path.path
    window_s = (LONGEST_LEAD_S + lead_s) * sampler.rate
    about_s = _nearest_s(path, sent, now_s, now_s + window_s)
    from_s = _nearest_s(path, sent, max(about_s - window_s / LOOKS, now_s), about_s + window_s / LOOKS)
    offset = sent - path.sample(from_s).position
    sampler.path, sampler.elapsed_s = Beside(path, offset, from_s) if offset.any() else path, from_s
    sampler.scaling.factor = sampler.rate = 0.0


def _nearest_s(path: Path, position: FloatArray, first_s: float, last_s: float) -> float:
    """When the path is nearest to a position (n,); where it comes by more than once, the first time."""
    nearest_s, least = first_s, np.inf
    for look_s in np.linspace(first_s, last_s, LOOKS + 1).tolist():
        off = float(np.linalg.norm(path.sample(look_s).position - position))
        if off > least:
            break
        if off < least:
            nearest_s, least = look_s, off
    return nearest_s


@dataclass(frozen=True, slots=True)
class Beside:
    """A path that is left by ``offset`` (n,) at ``from_s``, and soon is what it was."""

    path: Path
    offset: FloatArray
    from_s: float

    @property
    def duration_s(self) -> float:
        """Until the joints are on the path, and it has come to its end."""
        return max(self.path.duration_s, self.from_s + BESIDE_S)

    @property
    def asked_s(self) -> float:
        """No limit stretches it."""
        return self.path.asked_s + self.duration_s - self.path.duration_s

    def sample(self, time_s: float) -> Kinematics:
        """The joints' movement ``time_s`` after the start."""
        state, u = self.path.sample(time_s), max((time_s - self.from_s) / BESIDE_S, 0.0)
        if u >= 1.0:
            return state
        return Kinematics(
            state.position + self.offset * (1.0 - u**2 * (3.0 - 2.0 * u)),
            state.velocity - self.offset * (6.0 * u * (1.0 - u) / BESIDE_S),
            state.acceleration - self.offset * (6.0 * (1.0 - 2.0 * u) / BESIDE_S**2),
        )
