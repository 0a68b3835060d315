"""Motions of a local control stack: each goal is split into one part for each controller that moves its joints."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Protocol

import numpy as np

from controller.action_goals import DEACTIVATED, PREEMPTED, GoalStatus
from controller.fault_timeout import FaultTimeout
from controller.forward.forward_command_controller import ForwardCommandController
from controller.gripper.goal import GripperGoal, GripperHandle
from controller.gripper.gripper_action_controller import GripperActionController
from controller.interface import Controller
from controller.trajectory.execution import RECALL_S
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.goal_result import PREEMPTED_BY_TOPIC
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import FloatArray, Interface, JointState, joints_of
from servoloop.api.backend import JointGoal
from servoloop.api.errors import ArmEndedError, ArmInputError, MotionCanceledError, MotionFailedError

Mover = JointTrajectoryController | ForwardCommandController | GripperActionController
"""Controller that can move joints to positions."""
TRAJECTORY: Final = "/JointTrajectoryController"
FORWARD: Final = ("/ForwardCommandController", "/JointGroupPositionController")
GRIPPER: Final = "/GripperActionController"
CANCELED: Final = "the motion was canceled; the arm holds its position"
CYCLES_AFTER: Final = 3
"""Number of cycles by which a hand begins after the arm of the same motion, at least."""
REPLACED: Final = "another motion has replaced this one"


class MotionPart(Protocol):
    """Part of a motion that one controller executes."""

    @property
    def controller(self) -> Mover:
        """Controller that executes the part."""
        ...

    @property
    def done(self) -> bool:
        """Whether the part has ended."""
        ...

    @property
    def failure(self) -> MotionFailedError | None:
        """Why the part has failed, if it has."""
        ...

    @property
    def moves(self) -> bool:
        """Whether the part is under way and has not been canceled."""
        ...

    def begin_after_arm(self) -> None:
        """Begin just after the trajectory of the same motion."""
        ...

    def update(self, state: JointState, now_s: float) -> None:
        """Continue the part after a cycle, in the thread of the loop."""
        ...

    def cancel(self, replaced: bool = False) -> None:
        """End the part. Its joints slow down and hold. ``replaced``: whether another motion follows at once."""
        ...


@dataclass(slots=True)
class RunningMotion:
    """Progress of a goal on a local stack."""

    parts: tuple[MotionPart, ...]
    ended: Callable[[], ArmEndedError | None]

    @property
    def done(self) -> bool:
        """Whether all parts have ended, or the loop has."""
        return all(part.done for part in self.parts) or self.ended() is not None

    @property
    def failure(self) -> Exception | None:
        """First failure of a part, or ArmEndedError."""
        ended = self.ended()
        if ended is not None and any(not part.done or part.failure is not None for part in self.parts):
            return ended
        return next((part.failure for part in self.parts if part.failure is not None), None)


@dataclass(slots=True)
class TrajectoryPart:
    """Goal of a joint trajectory controller."""

    controller: JointTrajectoryController
    handle: GoalHandle
    canceled: bool = False
    """Whether a cancellation was requested. The handle is done when the joints are at rest."""

    @property
    def done(self) -> bool:
        return self.handle.done

    @property
    def failure(self) -> MotionFailedError | None:
        handle = self.handle
        if self.canceled and handle.status is GoalStatus.ABORTED:  # Another controller has taken the joints meanwhile.
            return MotionCanceledError(CANCELED)
        return _failure(handle.status, handle.error_text, self.controller.joints)

    @property
    def moves(self) -> bool:
        return not self.handle.done and not self.canceled

    def begin_after_arm(self) -> None:
        pass

    def update(self, state: JointState, now_s: float) -> None:
        pass

    def cancel(self, replaced: bool = False) -> None:
        if not replaced:  # The controller itself replaces a goal without a stop.
            self.canceled = True
            self.controller.cancel(self.handle)


def start_trajectory(controller: JointTrajectoryController, goal: JointGoal, held: FloatArray) -> TrajectoryPart:
    """Send a goal to a joint trajectory controller.

    Args:
        controller: The controller, which drives at least one joint of the goal.
        goal: A checked goal.
        held: Positions (n,) for the joints of the controller that the goal does not name.

    Raises:
        ArmInputError: The controller rejects the goal.
    """
    joints = controller.joints
    column = [goal.joints.index(joint) if joint in goal.joints else None for joint in joints]

    def row(values: Sequence[float], others: Sequence[float]) -> tuple[float, ...]:
        return tuple(float(others[i] if at is None else values[at]) for i, at in enumerate(column))

    still = np.zeros(len(joints)).tolist()
    velocities = [row(one, still) for one in goal.velocities] or [()] * len(goal.times_s)
    points = tuple(
        GoalPoint(row(positions, held.tolist()), time_s, speeds)
        for positions, time_s, speeds in zip(goal.positions, goal.times_s, velocities, strict=True)
    )
    sent = TrajectoryGoal(joints, points)
    if reason := controller.check(sent):
        raise ArmInputError(f"the arm does not accept the motion: {reason}", _joint_in(reason, joints))
    return TrajectoryPart(controller, controller.submit(sent))


@dataclass(frozen=True, slots=True)
class ControllerAccess:
    """Access to the loop of a controller that has no goals of its own."""

    period_s: float
    """Period of the loop, in seconds."""
    active: Callable[[], bool]
    """Returns whether the controller is active."""
    brake: Callable[[], None]
    """Requests that the joints of the controller slow down within their limits."""


@dataclass(slots=True)
class PartStart:
    """Start of a part that moves a hand.

    A trajectory controller may wait until other controllers have settled before it begins (``wait_for``). The hand of
    the same motion therefore begins just after the arm, and catches up.
    """

    with_arm: bool = False
    """Whether a trajectory controller moves other joints in the same motion."""
    begun_s: float | None = None
    """Time of the first cycle of the motion, in seconds."""
    cycles: int = 0

    def elapsed_s(self, now_s: float) -> float:
        """Return the time since the first cycle of the motion, in seconds. Call this in each cycle."""
        self.begun_s = now_s if self.begun_s is None else self.begun_s
        self.cycles += 1
        return now_s - self.begun_s

    def due(self, now_s: float) -> bool:
        """Return whether the hand may move."""
        return not self.with_arm or (self.cycles > CYCLES_AFTER and now_s - (self.begun_s or 0.0) > RECALL_S)


@dataclass(slots=True)
class ForwardPart:
    """Path of a forward command controller for positions: its command follows the path in each cycle."""

    controller: ForwardCommandController
    times_s: FloatArray
    """Times (k,) of the points since the start, beginning with 0."""
    positions: FloatArray
    """Points (k, n) in the order of the controller's joints, in rad or m, beginning with the present command."""
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
            self._end(MotionFailedError(_failed(DEACTIVATED)))
            return
        if lasting := self.faults.lasting(state.faults, self.access.period_s):
            self._end(MotionFailedError(_failed(lasting), next(iter(self.faults.cycles))))
            return
        elapsed_s = self.start.elapsed_s(now_s) + self.access.period_s
        if not self.start.due(now_s):
            return
        if not self.sent_last:
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
    controller: ForwardCommandController, goal: JointGoal, held: FloatArray, access: ControllerAccess
) -> ForwardPart:
    """Start a path of a forward command controller.

    Args:
        controller: The controller, which drives at least one joint of the goal.
        goal: A checked goal.
        held: Commanded positions (n,) of the joints of the controller.
        access: Access to the loop of the controller.
    """
    rows, held = np.array(goal.positions), np.where(np.isfinite(controller.command), controller.command, held)
    points = np.tile(held, (len(rows) + 1, 1))
    for column, joint in enumerate(controller.joints):
        if joint in goal.joints:
            points[1:, column] = rows[:, goal.joints.index(joint)]
    times_s = np.append(0.0, goal.times_s)
    first = int(times_s[1] == 0.0)
    return ForwardPart(
        controller, times_s[first:], points[first:], access, faults=FaultTimeout(tuple(controller.joints))
    )


@dataclass(slots=True)
class GripperPart:
    """Path of a gripper action controller: one goal after the other. A gripper that holds an object has arrived."""

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
        return _failure(self.handle.status, self.handle.text, (self.controller.joint,))

    @property
    def moves(self) -> bool:
        return not self.done

    def begin_after_arm(self) -> None:
        self.start.with_arm = True

    def update(self, state: JointState, now_s: float) -> None:
        self.start.elapsed_s(now_s)
        if self.start.due(now_s) and self.goals and not self.done and (self.handle is None or self.handle.done):
            self.handle = self.controller.submit(self.goals[0])
            del self.goals[0]  # Other threads read both: a finished goal with none after it is the end.

    def cancel(self, replaced: bool = False) -> None:
        if not self.done:
            self.canceled = MotionCanceledError(REPLACED if replaced else CANCELED)
            if self.handle is not None and not replaced:
                self.controller.cancel(self.handle)


def start_gripper(controller: GripperActionController, goal: JointGoal, held: FloatArray) -> GripperPart:
    """Start a path of a gripper action controller.

    The arguments and the errors are those of ``start_trajectory``.
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
            raise ArmInputError(f"the gripper does not accept the motion: {reason}", controller.joint)
    return GripperPart(controller, goals)


def joints_of_mover(controller: Controller) -> tuple[str, ...]:
    """Return the joints that a controller can move to positions; empty for all other controllers.

    The type is compared, not the class, because a test may wrap a controller.
    """
    positions = all(Interface.parse(name).kind == "position" for name in controller.command_interfaces)
    if not positions or not controller.kind.endswith((TRAJECTORY, *FORWARD, GRIPPER)):
        return ()
    return tuple(joints_of(controller.command_interfaces))


def _failure(status: GoalStatus, text: str, joints: Sequence[str]) -> MotionFailedError | None:
    if status in (GoalStatus.EXECUTING, GoalStatus.SUCCEEDED):
        return None
    if status is GoalStatus.CANCELED:
        return MotionCanceledError(CANCELED)
    if text in (PREEMPTED, PREEMPTED_BY_TOPIC):
        return MotionCanceledError(REPLACED)
    return MotionFailedError(_failed(text), _joint_in(text, joints))


def _failed(text: str) -> str:
    return (
        f"the motion ended before its target: {text.rstrip('.')}. The arm holds its position: remove the cause, then "
        "move again"
    )


def _joint_in(text: str, joints: Sequence[str]) -> str:
    """Return the first joint that a message names, or an empty text."""
    return next((word for word in re.findall(r"\w+", text) if word in joints), "")
