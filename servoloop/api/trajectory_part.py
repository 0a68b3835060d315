"""Part of a motion that one joint trajectory controller executes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from controller.action_goals import GoalStatus
from controller.motion import MotionError
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from servoloop.api.arm_errors import ArmInputError, MotionCanceledError, MotionFailedError
from servoloop.api.backend import MotionGoal
from servoloop.api.motions import CANCELED, failure_of, joint_in


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
        if self.canceled and handle.status is GoalStatus.ABORTED:  # Another controller took over the joints.
            return MotionCanceledError(CANCELED)
        return failure_of(handle.status, handle.error_text, self.controller.joints)

    @property
    def moves(self) -> bool:
        return not self.handle.done and not self.canceled

    def begin_after_arm(self) -> None:
        pass

    def update(self, state: JointState, now_s: float) -> None:
        pass

    def cancel(self, replaced: bool = False) -> None:
        if not self.handle.done and not replaced:  # The controller replaces goals itself, without stopping the joints.
            self.canceled = True
            self.controller.cancel(self.handle)


def check_trajectory(controller: JointTrajectoryController, goal: MotionGoal) -> Callable[[], TrajectoryPart]:
    """Check a goal for a joint trajectory controller. Joints that are not in the goal stay at rest or stop.

    Args:
        controller: The controller, which drives at least one joint of the goal.
        goal: A goal for the whole arm, whose values have been checked.

    Returns:
        Function that sends the goal to the controller.

    Raises:
        ArmInputError: The controller rejects the goal.
    """
    joints = controller.joints
    try:
        rest = controller.rest().tolist()
    except MotionError as error:
        raise ArmInputError(f"the arm rejected the motion: {error}", joint_in(str(error), joints)) from error
    column = [goal.joints.index(joint) if joint in goal.joints else None for joint in joints]

    def row(values: Sequence[float], others: Sequence[float]) -> tuple[float, ...]:
        return tuple(float(others[i] if at is None else values[at]) for i, at in enumerate(column))

    still = np.zeros(len(joints)).tolist()
    velocities = [row(one, still) for one in goal.velocities] or [()] * len(goal.times_s)
    points = tuple(
        GoalPoint(row(positions, rest), time_s, speeds)
        for positions, time_s, speeds in zip(goal.positions, goal.times_s, velocities, strict=True)
    )
    sent = TrajectoryGoal(joints, points)
    if reason := controller.check(sent):
        raise ArmInputError(f"the arm rejected the motion: {reason}", joint_in(reason, joints))
    return lambda: TrajectoryPart(controller, controller.submit(sent))
