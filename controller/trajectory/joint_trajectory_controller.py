"""Implement joint_trajectory_controller/JointTrajectoryController, with optional jerk limits."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from threading import Lock
from typing import ClassVar

import numpy as np

from controller.action_goals import DEACTIVATED, LONGEST_STEP, NOT_RUNNING, GoalStatus
from controller.interface import ControllerContext, Settled, indices, limits_of
from controller.motion import Kinematics, within_reach
from controller.parameters import Parameters
from controller.trajectory.active_goal import Cycle
from controller.trajectory.execution import GoalExecution
from controller.trajectory.goal import GoalHandle, TrajectoryGoal
from controller.trajectory.goal_planner import GoalPlanner, GoalRejected, Plan
from controller.trajectory.goal_result import ErrorCode
from controller.trajectory.parameters import SETTABLE, TrajectoryParameters
from controller.trajectory.sampler import Tracking, TrajectorySampler, shorter_way
from controller.trajectory.standstill import Standstill
from hal.types import FloatArray, JointLimits, JointState

UNSEEN = 100
"""Maximum number of cycles kept for a slow observer."""


class JointTrajectoryController:
    """Controller that follows one trajectory at a time.

    A new goal starts from the reference of the previous goal. ros2_control starts from the measured state, which makes
    the arm sag or jump at the start of each goal.
    """

    kind: ClassVar[str] = "joint_trajectory_controller/JointTrajectoryController"
    parameters_type: ClassVar[type[Parameters]] = TrajectoryParameters
    settable: ClassVar[frozenset[str]] = SETTABLE

    def __init__(
        self,
        name: str,
        parameters: TrajectoryParameters,
        limits: Sequence[JointLimits],
        hardware_joints: Sequence[str],
        settled: Settled,
        lags: FloatArray | None = None,
    ) -> None:
        """Create a controller. ``limits`` and ``lags`` are in joint order."""
        endless = tuple(index for index, limit in enumerate(limits) if math.isinf(limit.upper))
        self.name = name
        self.joints = parameters.joints
        self.command_interfaces = parameters.claims()
        self.state_interfaces = tuple(f"{j}/{name}" for j in self.joints for name in parameters.state_interfaces)
        self.reconfigure(parameters)
        self.command: FloatArray = np.full(len(self.joints), np.nan)
        self.tracking: Tracking | None = None
        """Data for the latest cycle, or None while the controller is inactive."""
        self._unseen: deque[Tracking] = deque(maxlen=UNSEEN)
        self.running = False
        self._planner = GoalPlanner(self.joints, tuple(limits), parameters.interpolation_method, endless)
        self._planner.warm_up()
        self._sampler = TrajectorySampler(limits, parameters.speed_scaling.initial_scaling_factor, lags)
        self.scaling = self._sampler.scaling
        self._velocity = np.array([limit.velocity for limit in limits])
        self._lead_s = parameters.command_lead
        self._index = np.array(indices(self.joints, hardware_joints), dtype=np.intp)
        self._execution = GoalExecution(name, self.joints, self._sampler, settled)
        self._planned: tuple[TrajectoryGoal, Plan] | None = None
        self._planning = Lock()
        """Lock that is held while a goal is planned or submitted. ROS and the command socket use separate threads.
        """
        self._start, self._measured = Kinematics.at_rest(self.command), self.command
        self.period_s = 0.0
        """Period of the loop, in seconds; 0 before the first cycle."""
        self._last_s = 0.0
        self._standstill = Standstill(self.joints, endless, self._sampler, self._execution)

    @classmethod
    def build(
        cls, name: str, parameters: TrajectoryParameters, context: ControllerContext
    ) -> "JointTrajectoryController":
        """Build the controller from its parameters and the robot."""
        limits = limits_of(parameters.joints, context.limits)
        lags = context.lags(parameters.joints)
        return cls(name, parameters, limits, context.component.joints, context.settled, lags)

    # Any thread may call the following methods.

    def check(self, goal: TrajectoryGoal) -> str | None:
        """Return the reason why a goal is rejected, or None. If the goal is accepted, its plan is kept for
        ``submit``."""
        with self._planning:
            return self._check(goal)

    def _check(self, goal: TrajectoryGoal) -> str | None:
        if not self.running:
            return NOT_RUNNING
        try:
            measured = self.tracking.feedback_position if self.tracking is not None else self._measured
            self._planned = goal, self._planner.plan(goal, self._allowed, self._next_reference(), measured)
        except GoalRejected as error:
            return str(error)
        return None

    def rest(self) -> FloatArray:
        """Return the positions (n,) at which the joints rest or can stop. Raises MotionError."""
        return self._planner.rest(self._next_reference())

    def _next_reference(self) -> Kinematics:
        """Return the reference for the next cycle."""
        tracking = self.tracking
        return tracking.at(self.period_s)[0] if tracking is not None else self._start

    def submit(self, goal: TrajectoryGoal) -> GoalHandle:
        """Start a goal that ``check`` has accepted. The goal takes effect in the next cycle."""
        handle = GoalHandle(goal)
        with self._planning:
            reason = self._check(goal) if self._planned is None or self._planned[0] is not goal else None
            if reason is None and self._planned is not None:
                self._execution.submit(handle, self._planned[1])
        if reason or not self.running:  # The controller may have been deactivated since the check.
            handle.decide(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, DEACTIVATED if not self.running else str(reason))
        return handle

    @property
    def newest_goal(self) -> GoalHandle | None:
        """The latest goal: queued, active or finished."""
        return self._execution.newest

    def cancel(self, handle: GoalHandle) -> None:
        """Cancel a goal if it is still active in the next cycle."""
        self._execution.cancel(handle)

    def tracked(self, stamp_s: float) -> Iterator[Tracking]:
        """Yield the tracking data of the cycle with the measurement time ``stamp_s``, for a single observer.

        Each cycle is yielded only once. Nothing is yielded if the controller was inactive or was not updated in that
        cycle.
        """
        while self._unseen and self._unseen[0].stamp_s <= stamp_s:
            tracking = self._unseen.popleft()
            if tracking.stamp_s == stamp_s:
                yield tracking

    def reconfigure(self, parameters: TrajectoryParameters) -> None:
        """Set the parameters that can be changed at run time.

        ``cmd_timeout`` applies from the next cycle onward. The other parameters apply from the next goal onward.
        """
        self._allowed, self._tolerances = parameters.allowed(), parameters.tolerances()
        self.parameters: TrajectoryParameters = parameters

    # Only the loop thread may call the following methods.

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._execution.end()
        self._sampler.hold(command)
        self._start, self._measured = self._sampler.reference(), state.position.take(self._index)
        self._last_s = state.stamp_s
        self._standstill.reset()
        self.command = command.copy()
        self._execution.begin_relief()  # The previous controller may have pressed a joint against an obstacle.
        self.running = True

    def deactivate(self, reason: str = "") -> None:
        """Abort all goals. If the deactivation was not requested by a client, ``reason`` tells the clients the
        cause."""
        self.running = False
        self._execution.end(reason)
        self.tracking = None

    def settled(self) -> bool:
        return self._execution.idle

    def begin_relief(self, state: JointState, command: FloatArray) -> None:
        self._sampler.hold(command)
        self._standstill.reset()
        self._last_s = state.stamp_s
        self.command = command.copy()
        self._execution.begin_relief()

    def relieve(self, state: JointState, now_s: float, period_s: float) -> bool:
        now = self._advance(state, now_s, period_s)
        goes_on = self._execution.relieve(now)
        self._put_command(now)
        return goes_on

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        now, sampler = self._advance(state, now_s, period_s), self._sampler
        self._execution.cycle(now)
        self._put_command(now)
        self.period_s = period_s
        assert sampler.path is not None, "the controller is updated before it is activated"
        shown = sampler.scaling.factor, sampler.path, sampler.elapsed_s, sampler.on_goal, sampler.rate
        self.tracking = Tracking(
            *(state.stamp_s, now.reference, now.measured, now.velocity, now.error, self.command), *shown
        )
        self._unseen.append(self.tracking)

    def _advance(self, state: JointState, now_s: float, period_s: float) -> Cycle:
        """Advance the reference to this cycle, and compare the joints with it."""
        step_s, self._last_s = min(now_s - self._last_s, LONGEST_STEP * period_s), now_s
        parameters, sampler, standstill = self.parameters, self._sampler, self._standstill
        measured, velocity = state.position.take(self._index), state.velocity.take(self._index)
        if state.faults or standstill.cycles:
            step_s = standstill.step(state.faults, step_s, self.command, measured, parameters)
        reference = sampler.advance(step_s)
        error = shorter_way(reference.position - measured, self._planner.endless)
        last = self.tracking
        before = (measured, error) if last is None else (last.feedback_position, last.error)
        return Cycle(
            *(state, reference, measured, before[0], velocity, error, before[1], step_s, period_s, parameters),
            *(self._tolerances, standstill.waits),
        )

    def _put_command(self, now: Cycle) -> None:
        """Set the command to the reference at the end of the cycle, shifted ahead by the lag of the joints."""
        sampler, parameters, period_s = self._sampler, now.parameters, now.period_s
        # Changing the lead during a motion would make the command jump.
        if not sampler.on_goal or (sampler.ended and self._execution.idle):
            self._lead_s = parameters.command_lead
        if not now.waits:
            ahead = sampler.ahead(period_s, self._lead_s)
            self.command = within_reach(ahead, self.command, self._velocity, period_s)
