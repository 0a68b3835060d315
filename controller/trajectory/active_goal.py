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
from controller.trajectory.tolerances import Tolerances
from hal.types import FloatArray, JointState

LONGEST_REST_S: Final = 0.5
"""So long after its stop a goal ends at the latest, whether the joints rest or swing."""


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
    was: FloatArray | None = None
    """Where they were measured in the last cycle (n,)."""

    def rests(self, now: Cycle, still: FloatArray, stands: bool) -> bool:
        """Whether the joints rest, the reference of which ``stands`` or not: none moved by more than ``still`` (n,)."""
        resting = self.was is not None and bool((np.abs(now.measured - self.was) <= still).all())
        self.was = now.measured
        self.stood_s += now.step_s if stands else 0.0
        return stands and (resting or self.stood_s > LONGEST_REST_S)
