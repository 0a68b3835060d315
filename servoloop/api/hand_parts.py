"""Parts of a motion that are executed by hand controllers, which are forward command controllers and gripper
controllers."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np

from controller.action_goals import DEACTIVATED
from controller.forward.forward_command_controller import ForwardCommandController
from controller.gripper.goal import GripperGoal, GripperHandle
from controller.gripper.gripper_action_controller import GripperActionController
from controller.trajectory.execution import RECALL_S
from hal.fault_timeout import FaultTimeout
from hal.types import FloatArray, JointState
from servoloop.api.arm_errors import ArmInputError, MotionCanceledError, MotionFailedError
from servoloop.api.backend import MotionGoal
from servoloop.api.motions import CANCELED, REPLACED, failed_text, failure_of

CYCLES_AFTER: Final = 3
"""Minimum number of cycles by which the hand starts after the arm in the same motion."""


@dataclass(frozen=True, slots=True)
class ControllerAccess:
    """Access to the control loop, for a controller that does not use goals."""

    period_s: float
    """Period of the loop, in seconds."""
    active: Callable[[], bool]
    """Function that returns whether the controller is active."""
    brake: Callable[[], None]
    """Function that makes the controller's joints slow down within their limits."""


@dataclass(slots=True)
class PartStart:
    """Start time of a part that moves a hand.

    A trajectory controller may wait until other controllers have settled before it begins (``wait_for``). In such a
    motion, the hand therefore starts just after the arm, and catches up.
    """

    with_arm: bool = False
    """Whether a trajectory controller moves other joints in the same motion."""
    begun_s: float | None = None
    """Time of the first cycle of the motion, in seconds."""
    cycles: int = 0

    def elapsed_s(self, now_s: float) -> float:
        """Return the time since the first cycle of the motion, in seconds. Call this method in each cycle."""
        self.begun_s = now_s if self.begun_s is None else self.begun_s
        self.cycles += 1
        return now_s - self.begun_s

    def due(self, now_s: float) -> bool:
        """Return whether the hand may move."""
        return not self.with_arm or (self.cycles > CYCLES_AFTER and now_s - (self.begun_s or 0.0) > RECALL_S)


@dataclass(slots=True)
class ForwardPart:
    """Path for a forward command controller. In each cycle, the commanded positions follow the path."""

    controller: ForwardCommandController
    times_s: FloatArray
    """Times (k,) of the points since the start of the motion, beginning with 0, in seconds."""
    positions: FloatArray
    """Points (k, n) in the order of the controller's joints, in rad or m. The value is NaN for a joint that stays at
    rest, or that stops if it is moving."""
    held: FloatArray
    """Commanded positions (n,) of the controller's joints, used for joints that the controller does not command."""
    access: ControllerAccess
    sent_last: bool = False
    """Whether the last point has been sent."""
    done: bool = False
    failure: MotionFailedError | None = None
    start: PartStart = field(default_factory=PartStart)
    faults: FaultTimeout = field(default_factory=lambda: FaultTimeout(()))

    @property
    def moves(self) -> bool:
        return not self.done

    def begin_after_arm(self) -> None:
        self.start.with_arm = True

    def update(self, state: JointState, now_s: float) -> None:
        if self.done:
            return
        if not self.access.active():
            self._end(MotionFailedError(failed_text(DEACTIVATED)))
            return
        if lasting := self.faults.lasting(state.faults, self.access.period_s):
            self._end(MotionFailedError(failed_text(lasting), next(iter(self.faults.cycles))))
            return
        elapsed_s = self.start.elapsed_s(now_s) + self.access.period_s
        if not self.start.due(now_s):
            return
        if not self.sent_last:
            if np.isnan(
                self.positions
            ).any():  # Joints without a target keep moving until the first message, which brings them to rest.
                rest = self.controller.rest(self.access.period_s)
                rest = np.where(np.isfinite(rest), rest, self.held)
                self.positions = np.where(np.isnan(self.positions), rest, self.positions)
            self.sent_last = bool(elapsed_s >= self.times_s[-1])
            self.controller.submit(self._at(elapsed_s))
        elif self.controller.settled():
            self._end(None)

    def cancel(self, replaced: bool = False) -> None:
        if not self.done:
            if not replaced:
                self.access.brake()
            self._end(MotionCanceledError(REPLACED if replaced else CANCELED))

    def _at(self, elapsed_s: float) -> list[float]:
        return [float(np.interp(elapsed_s, self.times_s, column)) for column in self.positions.T]

    def _end(self, failure: MotionFailedError | None) -> None:
        self.failure = failure
        self.done = True  # Other threads poll this flag, so it is set last.


def start_forward(
    controller: ForwardCommandController, goal: MotionGoal, held: FloatArray, access: ControllerAccess
) -> ForwardPart:
    """Start a path on a forward command controller. Joints that are not in the goal stay at rest or stop.

    Args:
        controller: The controller, which drives at least one joint of the goal.
        goal: A checked goal.
        held: Commanded positions (n,) of the controller's joints.
        access: Access to the controller's loop.
    """
    rows = np.array(goal.positions)
    points = np.full((len(rows) + 1, len(controller.joints)), np.nan)
    for column, joint in enumerate(controller.joints):
        if joint in goal.joints:
            points[1:, column] = rows[:, goal.joints.index(joint)]
    times_s = np.append(0.0, goal.times_s)
    first = int(times_s[1] == 0.0)
    return ForwardPart(
        controller, times_s[first:], points[first:], held, access, faults=FaultTimeout(tuple(controller.joints))
    )


@dataclass(slots=True)
class GripperPart:
    """Path for a gripper action controller, as a sequence of goals. A goal is considered reached if the gripper holds
    an object."""

    controller: GripperActionController
    goals: list[GripperGoal]
    start: PartStart = field(default_factory=PartStart)
    handle: GripperHandle | None = None
    canceled: MotionCanceledError | None = None

    @property
    def done(self) -> bool:
        over = self.handle is not None and self.handle.done
        return self.canceled is not None or (over and (not self.goals or self.failure is not None))

    @property
    def failure(self) -> MotionFailedError | None:
        if self.canceled is not None or self.handle is None or self.handle.state.stalled:
            return self.canceled
        return failure_of(self.handle.status, self.handle.text, (self.controller.joint,))

    @property
    def moves(self) -> bool:
        return not self.done

    def begin_after_arm(self) -> None:
        self.start.with_arm = True

    def update(self, state: JointState, now_s: float) -> None:
        self.start.elapsed_s(now_s)
        if self.start.due(now_s) and self.goals and not self.done and (self.handle is None or self.handle.done):
            self.handle = self.controller.submit(self.goals[0])
            del self.goals[0]  # Other threads consider the part finished once its handle is done and no goals remain.

    def cancel(self, replaced: bool = False) -> None:
        if not self.done:
            self.canceled = MotionCanceledError(REPLACED if replaced else CANCELED)
            if self.handle is not None and not replaced:
                self.controller.cancel(self.handle)


def start_gripper(controller: GripperActionController, goal: MotionGoal, held: FloatArray) -> GripperPart:
    """Start a path on a gripper action controller.

    Args:
        controller: The controller, which drives at least one joint of the goal.
        goal: A checked goal.
        held: Commanded position (1,) of the controller's joint.

    Raises:
        ArmInputError: The controller rejects the goal.
    """
    column = goal.joints.index(controller.joint)
    points = [(0.0, float(held[0])), *((t, row[column]) for t, row in zip(goal.times_s, goal.positions, strict=True))]
    still = controller.parameters.stall_velocity_threshold
    goals = [
        GripperGoal(after[1], max(abs(after[1] - before[1]) / max(after[0] - before[0], 1e-3), 2.0 * still))
        for before, after in pairwise(points)
    ]
    for one in goals:
        if reason := controller.check(one):
            raise ArmInputError(f"the gripper rejected the motion: {reason}", controller.joint)
    return GripperPart(controller, goals)
