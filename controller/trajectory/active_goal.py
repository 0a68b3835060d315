"""The goal under way, and the cycle in which it is looked at."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.fault_timeout import FaultTimeout
from controller.motion import Kinematics
from controller.trajectory.goal import GoalHandle
from controller.trajectory.goal_planner import Plan
from controller.trajectory.goal_result import GoalResult
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.sampler import TrajectorySampler
from controller.trajectory.tolerances import Tolerances
from hal.types import FloatArray, JointState

LONGEST_REST_S: Final = 0.5
"""So long after its stop a goal ends at the latest, whether the joints rest or swing."""

RESTS_S: Final = 0.09
"""For so long joints that rest stay where they are; less is where a joint turns round. Two cycles at 20 Hz."""


@dataclass(frozen=True, slots=True)
class Cycle:
    """One cycle of the controller; arrays (n,), ``error`` is the reference less what was measured."""

    state: JointState
    reference: Kinematics
    measured: FloatArray
    error: FloatArray
    step_s: float
    period_s: float
    parameters: TrajectoryParameters
    tolerances: Tolerances
    """The defaults for goals that bring none."""
    waits: bool
    """The joints stand: they have not been measured, or are on their way to a command that came late."""


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
    stood_s: float = 0.0
    """Seconds since their reference stands."""
    rests_at: FloatArray | None = None
    """Where they have been measured (n,) for ``rested_s``."""
    rested_s: float = 0.0

    @property
    def gives_way(self) -> bool:
        """Its joints are on their way back from where something held one of them."""
        return self.ending is not None and self.ending.give_way

    def rests(self, now: Cycle, still: FloatArray, stands: bool) -> bool:
        """Whether the joints rest, whose reference ``stands`` or not: none leaves its place by ``still`` (n,)."""
        self.rested_s += now.step_s
        if self.rests_at is None or (np.abs(now.measured - self.rests_at) > still).any():
            self.rests_at, self.rested_s = now.measured, 0.0
        self.stood_s += now.step_s if stands else 0.0
        return stands and (self.rested_s >= RESTS_S or self.stood_s > LONGEST_REST_S)


def commands_timed_out(sampler: TrajectorySampler, parameters: TrajectoryParameters) -> bool:
    """As upstream: for so long after the last point nothing new has come. What is measured is held then."""
    allowed_s, path = parameters.cmd_timeout, sampler.path
    if path is None or not sampler.on_goal or allowed_s <= parameters.constraints.goal_time:
        return False
    return sampler.elapsed_s - path.duration_s > allowed_s
