"""Play a motion: move slowly to its start, then play it while the dead-man switch is held."""

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
from hal.compensation.joint_offset import FADE_IN_S
from hal.types import FloatArray
from servoloop.manual.dead_man import Permission
from servoloop.teach.arm import TeachArm
from servoloop.teach.taught import RecordedMotion, TeachError, check_duration

APPROACH: Final = 0.25
"""Share of the velocity limits used on the way to the start of a motion and between poses."""


READY_S: Final = FADE_IN_S + 0.5
"""Time from enabling the torque until the servos carry the arm and have corrected its sag, in seconds."""


class PlayPhase(StrEnum):
    """State of a playback."""

    READYING = "getting ready"
    WAITING = "waiting: hold a key"
    APPROACHING = "moving slowly to the start"
    PLAYING = "playing"
    PAUSED = "paused: hold a key"
    DONE = "done"


class Play:
    """Playback of one motion, used in the thread of the user interface."""

    def __init__(
        self,
        arm: TeachArm,
        follow: JointTrajectoryController,
        motion: RecordedMotion,
        speed: float,
        permission: Permission,
    ) -> None:
        """Plan the playback.

        Args:
            arm: Arm that plays the motion.
            follow: Trajectory controller of the arm.
            motion: Motion of the arm's joints, in the order of the arm.
            speed: Share of the recorded speed, from 0 to 1.
            permission: Dead-man switch.

        Raises:
            TeachError: The motion cannot be played.
        """
        self.phase = PlayPhase.READYING
        self._arm, self._follow, self._permission = arm, follow, permission
        limits = arm.loop.limits
        if motion.path is not None:
            check_duration(motion.path.duration_s / speed, "the motion")
        points = goal_points(slowed(motion.path, limits, speed), limits) if motion.path is not None else ()
        self._check(motion.position, points)
        self._goals = self._make_goals(motion.position, points, speed)
        self._running: tuple[PlayPhase, GoalHandle] | None = None
        self._ready_s = math.inf

    def _check(self, poses: FloatArray, points: tuple[GoalPoint, ...]) -> None:
        """Plan the whole motion before the arm moves. Raises TeachError if the motion cannot be played."""
        joints, limits = self._arm.joints, self._arm.loop.limits
        planner = GoalPlanner(joints, limits, "ruckig")
        goals = [points] if points else [(_point(pose, 1e-3),) for pose in poses]
        begins = poses[:1] if points else poses[[0, *range(len(poses) - 1)]]
        for goal, begin in zip(goals, begins, strict=True):
            try:
                planner.plan(TrajectoryGoal(joints, goal), Allowed(), Kinematics.at_rest(begin))
            except GoalRejected as error:
                raise TeachError(f"the motion cannot be played, and the arm has not moved: {error}") from error

    def begin(self) -> None:
        """Enable torque at the current position. The arm moves only once the servos carry its weight."""
        self._follow.scaling.ask(0.0)
        self._arm.loop.activate()
        self._ready_s = self._arm.loop.clock.now() + READY_S

    def update(self, now_s: float) -> bool:
        """Move or stop the arm as the dead-man switch requires. Return False at the end of the motion.

        Raises TeachError if the motion fails.
        """
        allowed = self._permission.allowed(now_s)
        self._follow.scaling.ask(1.0 if allowed else 0.0)
        if self._permission.ended():
            return False
        if now_s < self._ready_s:
            return True
        if allowed and self._running is None and not self._next():
            return False
        if self._running is None:
            self.phase = PlayPhase.WAITING
            return True
        phase, handle = self._running
        self.phase = phase if allowed else PlayPhase.PAUSED
        if handle.done and handle.status is not GoalStatus.SUCCEEDED:
            raise TeachError(f"the arm has stopped: {handle.error_text}")
        return not handle.done or self._next()

    def _next(self) -> bool:
        """Start the next goal. Return False if there is no further goal."""
        found = next(self._goals, None)
        if found is None:
            self.phase = PlayPhase.DONE
            return False
        phase, goal = found
        if reason := self._follow.check(goal):
            raise TeachError(f"the motion cannot be played: {reason}")
        self._running = phase, self._follow.submit(goal)
        return True

    def _make_goals(
        self, poses: FloatArray, points: tuple[GoalPoint, ...], speed: float
    ) -> Iterator[tuple[PlayPhase, TrajectoryGoal]]:
        """Yield the goals of the motion. Each goal is computed only after the previous goal was reached."""
        if not points:
            for pose in poses:
                yield PlayPhase.PLAYING, self._slowly_to(pose, speed)
            return
        yield PlayPhase.APPROACHING, self._slowly_to(poses[0])
        yield PlayPhase.PLAYING, TrajectoryGoal(self._arm.joints, points)

    def _slowly_to(self, pose: FloatArray, speed: float = 1.0) -> TrajectoryGoal:
        limits = [replace(one, velocity=APPROACH * speed * one.velocity) for one in self._arm.loop.limits]
        here, there = Kinematics.at_rest(self._arm.loop.command), Kinematics.at_rest(pose)
        try:
            duration_s = motion_to(here, there, limits, 0.0, self._arm.joints).duration_s
        except MotionError as error:
            raise TeachError(f"the arm cannot move to the start of the motion: {error}") from error
        return TrajectoryGoal(self._arm.joints, (_point(pose, max(duration_s, 1e-3)),))


def _point(pose: FloatArray, time_s: float) -> GoalPoint:
    return GoalPoint(tuple(pose.tolist()), time_s)
