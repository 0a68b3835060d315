"""Playing back: a slow way to where the motion begins, then the motion, as long as it is allowed."""

import math
from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum
from typing import Final

from controller.action_goals import GoalStatus
from controller.motion import Kinematics, MotionError, motion_to
from controller.teach.slowing import goal_points, slowed
from controller.trajectory.goal import Allowed, GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.goal_planner import GoalPlanner, GoalRejected
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.compensation.gravity_compensation import FADE_IN_S
from hal.types import FloatArray
from servoloop.manual.dead_man import Permission
from servoloop.teach.arm import TeachArm
from servoloop.teach.taught import Taught, TeachError, check_duration

APPROACH: Final = 0.25
"""Share of each joint's velocity limit on the way to the beginning, and from pose to pose."""


READY_S: Final = FADE_IN_S + 0.5
"""So long after torque has come the servos carry the arm, and have brought it back from where it sagged."""


class Phase(StrEnum):
    """What the arm does."""

    READYING = "getting ready"
    WAITING = "waiting: hold a key"
    APPROACHING = "going to where it begins, slowly"
    PLAYING = "playing"
    PAUSED = "paused: hold a key"
    DONE = "done"


class Play:
    """One playing of a motion, in the person's thread."""

    def __init__(
        self, arm: TeachArm, follow: JointTrajectoryController, taught: Taught, speed: float, permission: Permission
    ) -> None:
        """``taught`` is of the arm's joints, in their order; ``speed`` (0 to 1) of that at which it was shown."""
        self.phase = Phase.READYING
        self._arm, self._follow, self._permission = arm, follow, permission
        limits = arm.loop.limits
        if taught.path is not None:
            check_duration(taught.path.duration_s / speed, "the motion")
        points = goal_points(slowed(taught.path, limits, speed), limits) if taught.path is not None else ()
        self._check(taught.position, points)
        self._goals = self._made(taught.position, points, speed)
        self._under_way: tuple[Phase, GoalHandle] | None = None
        self._ready_s = math.inf

    def _check(self, poses: FloatArray, points: tuple[GoalPoint, ...]) -> None:
        """Plan the whole motion once, before anything moves. Raises TeachError where it cannot be played."""
        joints, limits = self._arm.joints, self._arm.loop.limits
        planner = GoalPlanner(joints, limits, "ruckig")
        goals = [points] if points else [(_point(pose, 1e-3),) for pose in poses]
        begins = poses[:1] if points else poses[[0, *range(len(poses) - 1)]]
        for goal, begin in zip(goals, begins, strict=True):
            try:
                planner.plan(TrajectoryGoal(joints, goal), Allowed(), Kinematics.at_rest(begin))
            except GoalRejected as error:
                raise TeachError(f"this cannot be played, and nothing has moved: {error}") from error

    def begin(self) -> None:
        """Torque on where the arm stands; nothing moves until its weight is carried. Raises errors."""
        self._follow.scaling.ask(0.0)
        self._arm.loop.activate()
        self._ready_s = self._arm.loop.clock.now() + READY_S

    def look(self, now_s: float) -> bool:
        """Let the arm go on or stand, as the person wants; False at the end. Raises TeachError where it cannot."""
        allowed = self._permission.allowed(now_s)
        self._follow.scaling.ask(1.0 if allowed else 0.0)
        if self._permission.ended():
            return False
        if now_s < self._ready_s:
            return True
        if allowed and self._under_way is None and not self._next():
            return False
        if self._under_way is None:
            self.phase = Phase.WAITING
            return True
        phase, handle = self._under_way
        self.phase = phase if allowed else Phase.PAUSED
        if handle.done and handle.status is not GoalStatus.SUCCEEDED:
            raise TeachError(f"the arm stands: {handle.error_text}")
        return not handle.done or self._next()

    def _next(self) -> bool:
        """Set out on the next part; False where there is none."""
        found = next(self._goals, None)
        if found is None:
            self.phase = Phase.DONE
            return False
        phase, goal = found
        if reason := self._follow.check(goal):
            raise TeachError(f"this cannot be played: {reason}")
        self._under_way = phase, self._follow.submit(goal)
        return True

    def _made(
        self, poses: FloatArray, points: tuple[GoalPoint, ...], speed: float
    ) -> Iterator[tuple[Phase, TrajectoryGoal]]:
        """The goals, each made when the one before it has been reached."""
        if not points:
            for pose in poses:
                yield Phase.PLAYING, self._slowly_to(pose, speed)
            return
        yield Phase.APPROACHING, self._slowly_to(poses[0])
        yield Phase.PLAYING, TrajectoryGoal(self._arm.joints, points)

    def _slowly_to(self, pose: FloatArray, speed: float = 1.0) -> TrajectoryGoal:
        limits = [replace(one, velocity=APPROACH * speed * one.velocity) for one in self._arm.loop.limits]
        here, there = Kinematics.at_rest(self._arm.loop.command), Kinematics.at_rest(pose)
        try:
            duration_s = motion_to(here, there, limits, 0.0, self._arm.joints).duration_s
        except MotionError as error:
            raise TeachError(f"no way to where it begins: {error}") from error
        return TrajectoryGoal(self._arm.joints, (_point(pose, max(duration_s, 1e-3)),))


def _point(pose: FloatArray, time_s: float) -> GoalPoint:
    return GoalPoint(tuple(pose.tolist()), time_s)
