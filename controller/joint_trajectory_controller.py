"""joint_trajectory_controller/JointTrajectoryController: one trajectory at a time, jerk-limited where so configured."""

from collections import deque
from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from controller.acceptance import Acceptance, Refused
from controller.execution import Cycle, Execution
from controller.goal import ErrorCode, GoalHandle, GoalStatus, TrajectoryGoal
from controller.interface import Settled, Surroundings, indices, limits_of
from controller.judging import DEACTIVATED
from controller.motion import Kinematics
from controller.parameters import Parameters
from controller.plans import Plan
from controller.tracking import Follower, Tracking, shorter_way
from controller.trajectory_parameters import TrajectoryParameters
from hal.types import FloatArray, JointLimits, JointState

LONGEST_STEP = 2.0
"""A cycle that comes late moves the trajectory on by at most so many periods: no leap after a stall."""

UNSEEN = 100
"""So many cycles are kept for who looks on and is behind."""


class JointTrajectoryController:
    """Follows one trajectory at a time; a new goal takes over from the reference of the old one.

    Upstream takes over from the measured state, which makes the arm sag or jump at each goal.
    """

    kind: ClassVar[str] = "joint_trajectory_controller/JointTrajectoryController"
    parameters_type: ClassVar[type[Parameters]] = TrajectoryParameters
    settable: ClassVar[frozenset[str]] = frozenset(
        {
            "allow_partial_joints_goal",
            "allow_integration_in_goal_trajectories",
            "allow_nonzero_velocity_at_trajectory_end",
            "cmd_timeout",
            "constraints",
        }
    )

    def __init__(
        self,
        name: str,
        parameters: TrajectoryParameters,
        limits: Sequence[JointLimits],
        hardware_joints: Sequence[str],
        settled: Settled,
        endless: Sequence[int] = (),
    ) -> None:
        """``limits`` in the order of the joints; ``endless`` are the indices of those without ends."""
        self.name = name
        self.joints = parameters.joints
        self.command_interfaces = parameters.claims()
        self.state_interfaces = tuple(f"{j}/{name}" for j in self.joints for name in parameters.state_interfaces)
        self.parameters: TrajectoryParameters = parameters
        self.command: FloatArray = np.full(len(self.joints), np.nan)
        self.tracking: Tracking | None = None
        """The newest cycle; None while nothing is followed."""
        self._unseen: deque[Tracking] = deque(maxlen=UNSEEN)
        self.running = False
        self._acceptance = Acceptance(self.joints, tuple(limits), tuple(endless))
        self._acceptance.rehearse(parameters)
        self._follower = Follower(limits, parameters.speed_scaling.initial_scaling_factor)
        self.scaling = self._follower.scaling
        self._index = indices(self.joints, hardware_joints)
        self._execution = Execution(name, self.joints, self._follower, settled)
        self._planned: tuple[TrajectoryGoal, Plan] | None = None
        self._start = Kinematics.at_rest(self.command)
        self.period_s = 0.0
        """Of the loop; 0 before the first cycle."""
        self._last_s = 0.0

    @classmethod
    def build(
        cls, name: str, parameters: TrajectoryParameters, surroundings: Surroundings
    ) -> "JointTrajectoryController":
        """As the controllers file wants it."""
        kinds = [surroundings.description.joints[joint].kind for joint in parameters.joints]
        endless = [index for index, kind in enumerate(kinds) if kind == "continuous"]
        limits = limits_of(parameters.joints, surroundings.limits)
        return cls(name, parameters, limits, surroundings.component.joints, surroundings.settled, endless)

    # Called from any thread.

    def check(self, goal: TrajectoryGoal) -> str | None:
        """Why the goal is refused, or None; it is planned then, for ``submit``."""
        if not self.running:
            return "Can't accept new action goals. Controller is not running."
        try:
            self._planned = goal, self._acceptance.plan(goal, self.parameters, self._next_reference())
        except Refused as error:
            return str(error)
        return None

    def _next_reference(self) -> Kinematics:
        """Where the joints will be to be when the next cycle comes."""
        tracking = self.tracking
        return tracking.at(self.period_s)[0] if tracking is not None else self._start

    def submit(self, goal: TrajectoryGoal) -> GoalHandle:
        """Hand over a goal that ``check`` let pass. It takes effect in the next cycle."""
        handle = GoalHandle(goal)
        reason = self.check(goal) if self._planned is None or self._planned[0] is not goal else None
        if reason is None and self._planned is not None:
            self._execution.submit(handle, self._planned[1])
        if reason or not self.running:  # stopped since the check
            handle.decide(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, DEACTIVATED if not self.running else str(reason))
        return handle

    def cancel(self, handle: GoalHandle) -> None:
        """Stop it, if it is still under way at the next cycle."""
        self._execution.cancel(handle)

    def tracked(self, stamp_s: float) -> Iterator[Tracking]:
        """What the cycle that measured at ``stamp_s`` tracked: once, for one onlooker who goes from cycle to cycle.

        Nothing where it was inactive, or was not updated then.
        """
        while self._unseen and self._unseen[0].stamp_s <= stamp_s:
            tracking = self._unseen.popleft()
            if tracking.stamp_s == stamp_s:
                yield tracking

    def reconfigure(self, parameters: TrajectoryParameters) -> None:
        """What is ``settable`` counts from the next goal (``cmd_timeout``: the next cycle) on."""
        self.parameters = parameters

    # Called from the loop's thread.

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._execution.end()
        self._follower.hold(command)
        self._start = self._follower.reference()
        self._last_s = state.stamp_s
        self.command = command.copy()
        self.running = True

    def deactivate(self, reason: str = "") -> None:
        """``reason`` is for the clients, where nobody switched the controller but its hardware is lost."""
        self.running = False
        self._execution.end(reason)
        self.tracking = None

    def settled(self) -> bool:
        return self._execution.idle

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        step_s = min(now_s - self._last_s, LONGEST_STEP * period_s)
        self._last_s = now_s
        parameters = self.parameters
        reference = self._follower.advance(step_s)
        measured = state.position[self._index]
        error = shorter_way(reference.position - measured, self._acceptance.endless)
        self._execution.cycle(Cycle(state, reference, measured, error, step_s), parameters)
        self.command = self._follower.ahead(period_s + parameters.command_lead)
        self.period_s = period_s
        velocity = state.velocity[self._index]
        self.tracking = self._follower.tracking(state.stamp_s, reference, measured, velocity, error, self.command)
        self._unseen.append(self.tracking)
