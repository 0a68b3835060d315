"""Whether a goal can be executed, and how: worked out before anything moves, in the thread that takes goals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.goal import GoalPoint, TrajectoryGoal
from controller.goal_checks import limits_reason, reason_to_reject
from controller.motion import Kinematics, MotionError, plan_stop
from controller.plans import Plan, Task, prepare
from controller.trajectory_parameters import TrajectoryParameters
from controller.way_points import course_of, integrated, unwound
from hal.types import FloatArray, JointLimits


class Refused(Exception):
    """Why a goal is not accepted, for the client to read."""


@dataclass(frozen=True, slots=True)
class Acceptance:
    """What goals of one controller are held against; ``endless`` are the indices of joints without ends."""

    joints: tuple[str, ...]
    limits: tuple[JointLimits, ...]
    endless: tuple[int, ...] = ()

    def plan(self, goal: TrajectoryGoal, parameters: TrajectoryParameters, reference: Kinematics) -> Plan:
        """How it is to be executed from about ``reference``. Raises Refused."""
        if reason := reason_to_reject(goal, self.joints, parameters.allowed()):
            raise Refused(reason)
        if parameters.allow_integration_in_goal_trajectories:
            goal = integrated(goal, self.joints, reference)
        if reason := limits_reason(goal, self.joints, self.limits):
            raise Refused(reason)
        try:
            course = course_of(goal, self.joints, self._rest(goal.joints, reference))
            course = unwound(course, reference.position, self.endless)
            plan = prepare(parameters.interpolation_method, Task(reference, course, self.limits, self.joints))
            plan.join(reference, 0.0)
        except MotionError as error:
            raise Refused(str(error)) from error
        return plan

    def rehearse(self, parameters: TrajectoryParameters) -> None:
        """Plan once for nothing: the first goal must not wait until all that planning needs has been loaded."""
        here = np.clip(np.zeros(len(self.joints)), *self._ends())
        point = GoalPoint(tuple(here.tolist()), 1.0)
        self.plan(TrajectoryGoal(self.joints, (point,)), parameters, Kinematics.at_rest(here))

    def _rest(self, named: Sequence[str], reference: Kinematics) -> FloatArray:
        """Where the joints that the goal does not name stay: here, or where they can come to rest."""
        if len(named) == len(self.joints) or not reference.velocity.any():
            return reference.position
        rest = plan_stop(reference, self.limits)
        return np.clip(rest.sample(rest.duration_s).position, *self._ends())

    def _ends(self) -> tuple[list[float], list[float]]:
        return [limit.lower for limit in self.limits], [limit.upper for limit in self.limits]
