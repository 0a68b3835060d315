"""joint_trajectory_controller/JointTrajectoryController, with jerk-limited motion by ruckig."""

import logging
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from controller.goal import (
    ErrorCode,
    GoalHandle,
    GoalStatus,
    Tolerances,
    TrajectoryGoal,
    reason_to_reject,
    resolve,
)
from controller.interface import Settled, Surroundings, indices, limits_of
from controller.motion import Kinematics, Motion, MotionError, plan, plan_stop
from controller.parameters import Parameters
from controller.trajectory_parameters import TrajectoryParameters
from controller.way_points import way_points
from hal.types import FloatArray, JointLimits, JointState

LOG = logging.getLogger("servoloop.controller")

SILENT_CYCLES = 5
"""So many cycles in a row a servo may be silent before the goal is given up."""
LONGEST_STEP = 2.0
"""A cycle that comes late moves the trajectory on by at most so many periods: no leap after a stall."""

DEACTIVATED = "Current goal cancelled during deactivate transition."


@dataclass(frozen=True, slots=True)
class JtcSettings:
    """What the controllers file says. Tolerances are the defaults for goals that bring none."""

    joints: tuple[str, ...]
    may_end_moving: bool = False
    tolerances: Tolerances = field(default_factory=Tolerances)
    command_lead_s: float = 0.0
    """How long the servos lag behind their goals: so much earlier they are told."""
    wait_for: tuple[str, ...] = ()
    wait_for_timeout_s: float = 1.5


@dataclass(frozen=True, slots=True)
class Tracking:
    """One cycle as ``~/controller_state`` shows it; ``output`` (n,) is the command."""

    stamp_s: float
    reference: Kinematics
    feedback_position: FloatArray
    feedback_velocity: FloatArray
    output: FloatArray


@dataclass(slots=True)
class _Active:
    """The goal under way: waiting while ``motion`` is None, then following it."""

    handle: GoalHandle
    tolerances: Tolerances
    waited_s: float = 0.0
    motion: Motion | None = None
    silent: dict[str, int] = field(default_factory=dict)


class JointTrajectoryController:
    """Follows one trajectory at a time; a new goal takes over from the reference of the old one."""

    kind: ClassVar[str] = "joint_trajectory_controller/JointTrajectoryController"
    parameters_type: ClassVar[type[Parameters]] = TrajectoryParameters

    def __init__(
        self,
        name: str,
        settings: JtcSettings,
        limits: Sequence[JointLimits],
        hardware_joints: Sequence[str],
        settled: Settled,
    ) -> None:
        self.name = name
        self.parameters = Parameters()
        self.joints = settings.joints
        self.command_interfaces = tuple(f"{joint}/position" for joint in self.joints)
        self.state_interfaces = tuple(f"{joint}/{name}" for joint in self.joints for name in ("position", "velocity"))
        self.settings = settings
        self.command: FloatArray = np.full(len(self.joints), np.nan)
        self.tracking: Tracking | None = None
        self._limits = tuple(limits)
        self._index = indices(self.joints, hardware_joints)
        self._others_settled = settled
        self._inbox: deque[GoalHandle] = deque()
        self._cancels: deque[GoalHandle] = deque()
        self._active: _Active | None = None
        self._motion: Motion | None = None
        self._elapsed_s = 0.0
        self._last_s = 0.0
        self._running = False

    @classmethod
    def build(
        cls, name: str, parameters: TrajectoryParameters, surroundings: Surroundings
    ) -> "JointTrajectoryController":
        """As the controllers file wants it."""
        settings = JtcSettings(
            joints=parameters.joints,
            may_end_moving=parameters.allow_nonzero_velocity_at_trajectory_end,
            tolerances=parameters.tolerances(),
            command_lead_s=parameters.command_lead,
            wait_for=parameters.wait_for,
            wait_for_timeout_s=parameters.wait_for_timeout,
        )
        limits = limits_of(parameters.joints, surroundings.limits)
        made = cls(name, settings, limits, surroundings.component.joints, surroundings.settled)
        made.parameters = parameters
        return made

    # Called from any thread.

    def check(self, goal: TrajectoryGoal) -> str | None:
        """Why the goal is refused, or None."""
        if not self._running:
            return "Can't accept new action goals. Controller is not running."
        return reason_to_reject(goal, self.joints, self._limits, self.settings.may_end_moving)

    def submit(self, goal: TrajectoryGoal) -> GoalHandle:
        """Hand over a goal that ``check`` let pass. It takes effect in the next cycle."""
        handle = GoalHandle(goal)
        self._inbox.append(handle)
        if not self._running:  # stopped since the check
            handle.decide(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, DEACTIVATED)
        return handle

    def cancel(self, handle: GoalHandle) -> None:
        """Stop it within the limits, if it is still under way at the next cycle."""
        self._cancels.append(handle)

    # Called from the loop's thread.

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._refuse_waiting()
        self._cancels.clear()
        self._hold(command)
        self._last_s = state.stamp_s
        self.command = command.copy()
        self._running = True

    def deactivate(self) -> None:
        self._running = False
        if self._active:
            self._active.handle.decide(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, DEACTIVATED)
        self._refuse_waiting()
        self._active = None

    def settled(self) -> bool:
        return self._active is None and not self._inbox

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        step_s = min(now_s - self._last_s, LONGEST_STEP * period_s)
        self._last_s = now_s
        self._elapsed_s += step_s
        reference = self._sample(0.0)
        self._take_cancels(reference)
        self._take_goals(reference)
        if self._active:
            self._advance(self._active, state, reference, step_s)
        self.command = self._sample(period_s + self.settings.command_lead_s).position
        self.tracking = Tracking(
            state.stamp_s,
            reference,
            state.position[self._index],
            state.velocity[self._index],
            self.command,
        )

    def _refuse_waiting(self) -> None:
        while self._inbox:
            self._inbox.popleft().decide(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, DEACTIVATED)

    def _sample(self, ahead_s: float) -> Kinematics:
        assert self._motion is not None, "activated before the first update"
        return self._motion.sample(self._elapsed_s + ahead_s)

    def _hold(self, position: FloatArray) -> None:
        self._follow(plan_stop(Kinematics.at_rest(position), self._limits))

    def _follow(self, motion: Motion) -> None:
        self._motion, self._elapsed_s = motion, 0.0

    def _stop(self, reference: Kinematics) -> None:
        self._active = None
        self._follow(plan_stop(reference, self._limits))

    def _take_cancels(self, reference: Kinematics) -> None:
        while self._cancels:
            handle = self._cancels.popleft()
            if self._active and self._active.handle is handle:
                self._stop(reference)
            elif handle in self._inbox:
                self._inbox.remove(handle)
            handle.decide(GoalStatus.CANCELED, ErrorCode.SUCCESSFUL, "")

    def _take_goals(self, reference: Kinematics) -> None:
        while self._inbox:
            handle = self._inbox.popleft()
            if self._active:
                text = "Current goal preempted by new incoming action."
                self._active.handle.decide(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, text)
            self._active = _Active(handle, self._tolerances(handle.goal.tolerances))
            if self._inbox:
                continue  # a newer one has come already: this one is not worth planning
            if self.settings.wait_for:
                self._follow(plan_stop(reference, self._limits))
            else:
                self._start(self._active, reference)

    def _tolerances(self, asked: Tolerances) -> Tolerances:
        """As upstream: a goal whose tolerances make no sense is executed with the defaults."""
        try:
            return resolve(asked, self.settings.tolerances, self.joints)
        except ValueError as error:
            LOG.error("%s: in the goal's tolerances %s: using the default tolerances", self.name, error)
            return self.settings.tolerances

    def _start(self, active: _Active, reference: Kinematics) -> None:
        goal = active.handle.goal
        if goal.delay_s:  # a stamp is a point in time: waiting brings it nearer
            goal = replace(goal, delay_s=goal.delay_s - active.waited_s)
        try:
            points = way_points(goal, self.joints, self._limits)
            motion = plan(reference, points, self._limits)
        except MotionError as error:
            self._give_up(active, reference, ErrorCode.INVALID_GOAL, str(error))
            return
        if motion.stretched:
            LOG.warning(
                "%s: %s",
                self.name,
                f"the limits stretch the motion from {motion.asked_s:.2f} s to {motion.duration_s:.2f} s",
            )
        active.motion = motion
        self._follow(motion)

    def _advance(self, active: _Active, state: JointState, reference: Kinematics, step_s: float) -> None:
        if fault := self._lasting_fault(active, state):
            self._give_up(active, reference, ErrorCode.PATH_TOLERANCE_VIOLATED, fault)
        elif active.motion is None:
            self._wait(active, reference, step_s)
        else:
            self._judge(active, active.motion, state, reference)

    def _lasting_fault(self, active: _Active, state: JointState) -> str | None:
        active.silent = {name: active.silent.get(name, 0) + 1 for name in self.joints if name in state.faults}
        lasting = [name for name, cycles in active.silent.items() if cycles >= SILENT_CYCLES]
        return "; ".join(state.faults[name] for name in lasting) or None

    def _wait(self, active: _Active, reference: Kinematics, step_s: float) -> None:
        """Start when the others have settled. Never in the first cycle: a command that was sent in
        the same instant as the goal may arrive just behind it."""
        ready = active.waited_s > 0.0 and all(map(self._others_settled, self.settings.wait_for))
        late = active.waited_s >= self.settings.wait_for_timeout_s
        if late and not ready:
            LOG.warning("%s: starts although %s has not settled", self.name, ", ".join(self.settings.wait_for))
        if ready or late:
            self._start(active, reference)
        else:
            active.waited_s += step_s

    def _judge(self, active: _Active, motion: Motion, state: JointState, reference: Kinematics) -> None:
        error = np.abs(reference.position - state.position[self._index])
        after_end_s = self._elapsed_s - motion.duration_s
        if self._exceeds(error, active.tolerances.path) and after_end_s < 0.0:
            text = "Aborted due to path tolerance violation"
            self._give_up(active, reference, ErrorCode.PATH_TOLERANCE_VIOLATED, text)
        elif after_end_s >= 0.0:
            self._judge_end(active, motion, error, after_end_s)

    def _judge_end(self, active: _Active, motion: Motion, error: FloatArray, after_end_s: float) -> None:
        allowed_s = active.tolerances.goal_time_s
        if not self._exceeds(error, active.tolerances.goal):
            text = "Goal successfully reached!"
            if motion.stretched:
                text += f" The limits stretched it from {motion.asked_s:.2f} s to {motion.duration_s:.2f} s."
            active.handle.decide(GoalStatus.SUCCEEDED, ErrorCode.SUCCESSFUL, text)
            self._active = None
        elif 0.0 < allowed_s < after_end_s:
            text = f"Aborted due to goal_time_tolerance exceeding by {after_end_s:f} seconds"
            active.handle.decide(GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED, text)
            self._active = None  # it stands already: the last point goes on being held

    def _exceeds(self, error: FloatArray, tolerance: Mapping[str, float]) -> bool:
        return any(
            0.0 < tolerance.get(name, 0.0) < deviation for name, deviation in zip(self.joints, error, strict=True)
        )

    def _give_up(self, active: _Active, reference: Kinematics, error_code: int, text: str) -> None:
        LOG.error("%s: %s", self.name, text)
        active.handle.decide(GoalStatus.ABORTED, error_code, text)
        self._stop(reference)
