"""Implement parallel_gripper_action_controller/GripperActionController.

Unlike in ros2_control, the fingers move within the velocity, acceleration and jerk limits of the joint. Goals beyond
the position limits are rejected. When a goal is canceled, the fingers stop without a jump.
"""

import logging
from collections import deque
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from controller.action_goals import DEACTIVATED, LONGEST_STEP, NOT_RUNNING, PREEMPTED, GoalStatus
from controller.gripper.goal import (
    GripperGoal,
    GripperHandle,
    GripperParameters,
    GripperState,
    reason_to_reject,
    velocity_of,
)
from controller.interface import ControllerContext
from controller.motion import Kinematics, MotionError, RuckigMotion, motion_to, plan_stop, within_reach
from controller.parameters import Parameters
from controller.settling import Settling
from controller.unmeasured import Unmeasured
from hal.fault_timeout import FaultTimeout
from hal.types import FloatArray, JointLimits, JointState, apart

LOG = logging.getLogger("servoloop.controller")

NOISE_SHARE: Final = 0.16
"""Maximum motion that is ignored after the commanded motion has ended, as a fraction of the goal tolerance.

With the default tolerance, this is just above one count of a servo with 4096 counts per turn.
"""


class GripperActionController:
    """Controller of one gripper joint. A new goal starts from the reference position of the previous goal."""

    kind: ClassVar[str] = "parallel_gripper_action_controller/GripperActionController"
    parameters_type: ClassVar[type[Parameters]] = GripperParameters
    settable: ClassVar[frozenset[str]] = frozenset(
        {"goal_tolerance", "allow_stalling", "stall_velocity_threshold", "stall_timeout", "max_velocity"}
    )

    def __init__(self, name: str, parameters: GripperParameters, limits: JointLimits, index: int) -> None:
        """Create a controller. ``index`` is the position of the joint in the hardware's joint order."""
        self.name = name
        self.parameters = parameters
        self.joint = parameters.joint
        self.command_interfaces = parameters.claims()
        self.state_interfaces = tuple(f"{self.joint}/{name}" for name in parameters.state_interfaces)
        self.command: FloatArray = np.full(1, np.nan)
        self.state: GripperState | None = None
        """State of the gripper in the latest cycle, or None while the controller is inactive."""
        self._limits = limits
        self._velocity = np.array([limits.velocity])
        self._index = index
        self._inbox: deque[GripperHandle] = deque()
        self._cancels: deque[GripperHandle] = deque()
        self._active: GripperHandle | None = None
        self.newest_goal: GripperHandle | None = None
        """The most recent goal: queued, active or finished."""
        self._motion: RuckigMotion | None = None
        self._settling = Settling((self.joint,), (limits,), (index,))
        self._fault_timeout = FaultTimeout((self.joint,))
        self._unmeasured = Unmeasured((self.joint,))
        self._elapsed_s = self._last_s = self._still_s = 0.0
        self._stood_at = np.nan
        """Position at which the fingers have been at rest for ``_still_s``, in rad or m."""
        self._running = False

    @classmethod
    def build(cls, name: str, parameters: GripperParameters, context: ControllerContext) -> "GripperActionController":
        """Build the controller from its parameters and the robot."""
        joint = parameters.joint
        return cls(name, parameters, context.limits[joint], context.component.joints.index(joint))

    # Any thread may call the following methods.

    def check(self, goal: GripperGoal) -> str | None:
        """Return the reason why a goal is rejected, or None."""
        if not self._running:
            return NOT_RUNNING
        return reason_to_reject(goal, self.joint, self._limits, self.parameters)

    def submit(self, goal: GripperGoal) -> GripperHandle:
        """Start a goal that ``check`` has accepted. The goal takes effect in the next cycle."""
        handle = self.newest_goal = GripperHandle(goal)
        self._inbox.append(handle)
        if not self._running:  # The controller may have been deactivated since the check.
            handle.decide(GoalStatus.ABORTED, GripperState(), DEACTIVATED)
        return handle

    def cancel(self, handle: GripperHandle) -> None:
        """Cancel a goal that is still active in the next cycle. The fingers stop within their velocity, acceleration
        and jerk limits."""
        self._cancels.append(handle)

    def reconfigure(self, parameters: GripperParameters) -> None:
        """Set the parameters that can be changed at run time. The new values take effect immediately."""
        self.parameters = parameters

    # Only the loop thread may call the following methods.

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._refuse_waiting()
        self._follow(plan_stop(Kinematics.at_rest(command), (self._limits,)))
        self._last_s = state.stamp_s
        self._unmeasured.reset()
        self.command = command.copy()
        self._settling.begin()
        self.state = None
        self._running = True

    def deactivate(self, reason: str = "") -> None:
        self._running = False
        if self._active:
            self._active.decide(GoalStatus.ABORTED, self.state or GripperState(), DEACTIVATED)
        self._refuse_waiting()
        self._active = self.state = None

    def settled(self) -> bool:
        return self._settling.settled and self._active is None and not self._inbox

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        step_s = min(now_s - self._last_s, LONGEST_STEP * period_s)
        self._last_s = now_s
        if state.faults or self._unmeasured.cycles:
            step_s = self._unmeasured.step_s(state.faults, step_s)
        self._elapsed_s += step_s
        self.state = self._measured(state)
        reference = self._sample(0.0)
        self._take_cancels(reference)
        self._take_goals(reference)
        if self._active:
            self._check_goal(self._active, state, step_s, period_s)
        goal = self._sample(period_s).position
        self.command = within_reach(goal, self.command, self._velocity, period_s)
        if self._elapsed_s >= self._duration_s:
            self._settling.update(goal, self.command, state, period_s)

    @property
    def _duration_s(self) -> float:
        return 0.0 if self._motion is None else self._motion.duration_s

    def _measured(self, state: JointState) -> GripperState:
        at = self._index
        return GripperState(float(state.position[at]), float(state.velocity[at]), float(state.effort[at]))

    def _refuse_waiting(self) -> None:
        while self._inbox:
            self._inbox.popleft().decide(GoalStatus.ABORTED, GripperState(), DEACTIVATED)

    def _sample(self, ahead_s: float) -> Kinematics:
        assert self._motion is not None, "the controller is updated before it is activated"
        return self._motion.sample(self._elapsed_s + ahead_s)

    def _follow(self, motion: RuckigMotion) -> None:
        self._motion, self._elapsed_s = motion, 0.0

    def _stop(self, reference: Kinematics) -> None:
        self._active = None
        self._follow(plan_stop(reference, (self._limits,)))

    def _decide(self, handle: GripperHandle, status: GoalStatus, text: str, **flags: bool) -> None:
        assert self.state is not None, "a result is decided before the first measurement"
        handle.decide(status, replace(self.state, **flags), text)

    def _take_cancels(self, reference: Kinematics) -> None:
        while self._cancels:
            handle = self._cancels.popleft()
            while handle in self._inbox:  # This goal has replaced all earlier goals.
                if self._active:
                    self._decide(self._active, GoalStatus.ABORTED, PREEMPTED)
                self._active = self._inbox.popleft()
            if self._active is handle:
                self._stop(reference)
            self._decide(handle, GoalStatus.CANCELED, "canceled: the fingers stop where they are")

    def _take_goals(self, reference: Kinematics) -> None:
        while self._inbox:
            if self._active:
                self._decide(self._active, GoalStatus.ABORTED, PREEMPTED)
            self._active = self._inbox.popleft()
            if not self._inbox:  # A newer goal in the queue would replace this goal immediately.
                self._start(self._active, reference)

    def _start(self, handle: GripperHandle, reference: Kinematics) -> None:
        goal = handle.goal
        limits = (replace(self._limits, velocity=velocity_of(goal, self._limits, self.parameters)),)
        target = Kinematics.at_rest(np.array([goal.position]))
        try:
            self._follow(motion_to(reference, target, limits, 0.0))
        except MotionError as error:
            self._give_up(handle, reference, str(error))
        assert self.state is not None, "a goal starts before the first measurement"
        self._still_s, self._stood_at = 0.0, self.state.position
        self._fault_timeout = FaultTimeout((self.joint,))
        self._settling.command_changed()

    def _check_goal(self, handle: GripperHandle, state: JointState, step_s: float, period_s: float) -> None:
        assert self.state is not None, "a goal is checked before the first measurement"
        if fault := self._fault_timeout.lasting(state.faults, period_s):
            self._give_up(handle, self._sample(0.0), fault)
        elif self.joint in state.faults:
            return  # While the fingers are not measured, their last known position does not indicate a stall.
        elif abs(handle.goal.position - self.state.position) < self.parameters.goal_tolerance:
            self._end(handle, GoalStatus.SUCCEEDED, "the goal is reached", reached_goal=True)
        elif self._stalls(self.state, step_s):
            good = self.parameters.allow_stalling
            status = GoalStatus.SUCCEEDED if good else GoalStatus.ABORTED
            text = "stalled at {}, short of {}".format(*apart(self.state.position, handle.goal.position))
            self._end(handle, status, text, stalled=True)

    def _stalls(self, now: GripperState, step_s: float) -> bool:
        """Return whether the fingers have stalled.

        The change of position is also checked, because the velocity may be unknown or below the servo's resolution.
        After the commanded motion ends, a motion of one encoder count is ignored.
        """
        slowest = self.parameters.stall_velocity_threshold
        noise = NOISE_SHARE * self.parameters.goal_tolerance if self._elapsed_s >= self._duration_s else 0.0
        shift = abs(now.position - self._stood_at)
        if abs(now.velocity) > slowest or shift > max(slowest * step_s, noise):
            self._still_s, self._stood_at = 0.0, now.position
        else:
            self._still_s += step_s
        return self._still_s > self.parameters.stall_timeout

    def _end(self, handle: GripperHandle, status: GoalStatus, text: str, **flags: bool) -> None:
        """Set the result of the goal. The command does not change, so the fingers continue to hold an object."""
        self._active = None
        self._decide(handle, status, text, **flags)

    def _give_up(self, handle: GripperHandle, reference: Kinematics, text: str) -> None:
        LOG.error("%s: %s", self.name, text)
        self._decide(handle, GoalStatus.ABORTED, text)
        self._stop(reference)


class PositionGripperActionController(GripperActionController):
    """Gripper controller that uses ros2_control's older action, GripperCommand."""

    kind: ClassVar[str] = "position_controllers/GripperActionController"
