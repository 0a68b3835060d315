"""Play a motion: move slowly to its start, then follow it while the dead-man switch is held."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Final

import numpy as np

from controller.motion import Kinematics
from controller.teach.slowing import goal_points, slowed
from controller.trajectory.goal import Allowed, TrajectoryGoal
from controller.trajectory.goal_planner import GoalPlanner, GoalRejected
from hal.types import FloatArray
from servoloop.api.arm import Arm
from servoloop.api.motion import ArmMotion
from servoloop.api.trajectory import ArmTrajectory
from servoloop.manual.dead_man import Permission
from servoloop.teach.motion_files import RecordedMotion, TeachError, check_duration

APPROACH: Final = 0.25
"""Fraction of the velocity limits used when moving to the start of a motion and between poses."""
AHEAD_S: Final = 1.0
"""Maximum time by which the arm can be ahead of the path's schedule, in seconds."""


class PlayPhase(StrEnum):
    """State of a playback."""

    WAITING = "waiting: hold a key"
    APPROACHING = "moving slowly to the start"
    PLAYING = "playing"
    PAUSED = "paused: hold a key"
    DONE = "done"


class Play:
    """Playback of one motion, which runs in the user interface thread.

    When the key is released, the joints slow down within their limits and hold their positions. When the key is held
    again, the arm moves slowly to the next point of the path and resumes.
    """

    def __init__(self, arm: Arm, motion: RecordedMotion, speed: float, permission: Permission) -> None:
        """Plan the playback.

        Args:
            arm: The arm, connected or in this process.
            motion: Motion of the arm's joints, in the arm's joint order.
            speed: Fraction of the recorded speed, from 0 to 1.
            permission: Dead-man switch.

        Raises:
            TeachError: The motion cannot be played.
        """
        self.phase = PlayPhase.WAITING
        self._arm, self._speed, self._permission = arm, speed, permission
        self._legs = _legs(arm, motion, speed)
        self._running: ArmMotion | None = None
        self._began_s = 0.0

    def update(self) -> bool:
        """Move or stop the arm as the dead-man switch requires. Return False when the motion has ended.

        Raises:
            TeachError: The arm stopped before the end of the motion.
            ArmError: The arm cannot be moved.
        """
        now_s = self._arm.state.time_s
        allowed = self._permission.allowed(now_s) and not self._permission.ended()
        if not allowed:
            self._pause()
            return not self._permission.ended()
        if self._running is None:
            self._begin(now_s)
        elif self._running.done:
            return self._next(self._running, now_s)
        return True

    def _begin(self, now_s: float) -> None:
        self.phase, self._began_s = self._legs[0].phase, now_s
        self._running = self._legs[0].begin(self._arm, self._speed)

    def _next(self, ended: ArmMotion, now_s: float) -> bool:
        if ended.failure is not None:
            raise TeachError(f"the arm has stopped: {ended.failure}") from ended.failure
        self._legs, self._running = self._legs[1:], None
        if not self._legs:
            self.phase = PlayPhase.DONE
            return False
        self._begin(now_s)
        return True

    def _pause(self) -> None:
        """Stop the arm, so that the motion can be resumed later from the position where the arm comes to rest."""
        if self._running is None:
            return
        state = self._arm.state
        self._running.cancel()
        self._running, self.phase = None, PlayPhase.PAUSED
        at = np.array([state.command[joint] for joint in self._arm.joints])
        self._legs = [*self._legs[0].rest(at, state.time_s - self._began_s), *self._legs[1:]]


class _Leg:
    """Segment of a motion from rest to rest: a path, or a slow motion to a single pose."""

    def __init__(self, joints: Sequence[str], times_s: FloatArray, position: FloatArray, velocity: FloatArray) -> None:
        """Create a path with k points, given their times (k,), positions (k, n) and velocities (k, n)."""
        self._joints = tuple(joints)
        self._times_s, self._position, self._velocity = times_s, position, velocity
        self.phase = PlayPhase.PLAYING

    def begin(self, arm: Arm, speed: float) -> ArmMotion:
        """Start the motion: either follow the path, or move slowly to the pose. The arm must be near the first point of
        a path."""
        if len(self._times_s) == 1:
            pose = dict(zip(self._joints, self._position[0].tolist(), strict=True))
            share = APPROACH if self.phase is PlayPhase.APPROACHING else APPROACH * speed
            return arm.move_to(pose, speed=share, wait=False)
        positions = {joint: self._position[:, index].tolist() for index, joint in enumerate(self._joints)}
        velocities = {joint: self._velocity[:, index].tolist() for index, joint in enumerate(self._joints)}
        times_s = (self._times_s - self._times_s[0]).tolist()
        return arm.follow(ArmTrajectory(times_s, positions, velocities), approach=APPROACH, wait=False)

    def approached(self) -> "list[_Leg]":
        """Return two segments: the slow motion to the first point of the path, and the path itself."""
        first = _Leg(self._joints, self._times_s[:1], self._position[:1], self._velocity[:1])
        first.phase = PlayPhase.APPROACHING
        return [first, self]

    def rest(self, at: FloatArray, passed_s: float) -> "list[_Leg]":
        """Return the remaining motion, starting at the path point nearest to a position (n,).

        ``passed_s`` is the time since the start of the path.
        """
        if len(self._times_s) == 1:
            return [self]
        reachable = self._times_s - self._times_s[0] <= passed_s + AHEAD_S
        distance = np.abs(self._position - at).max(axis=1)
        first = int(np.argmin(np.where(reachable, distance, np.inf)))
        rest = _Leg(self._joints, self._times_s[first:], self._position[first:], self._velocity[first:])
        return rest.approached()


def _legs(arm: Arm, motion: RecordedMotion, speed: float) -> list[_Leg]:
    """Plan a motion and return its segments. Raises TeachError if the motion cannot be played."""
    joints, limits = arm.joints, tuple(arm.limits[joint] for joint in arm.joints)
    if motion.path is None:
        rest = np.zeros((1, len(joints)))
        return [_Leg(joints, np.zeros(1), pose[None, :], rest) for pose in motion.position]
    check_duration(motion.path.duration_s / speed, "the motion")
    path = slowed(motion.path, limits, speed)
    points = goal_points(path, limits)
    try:
        first = Kinematics.at_rest(path.position[0])
        GoalPlanner(joints, limits, "ruckig").plan(TrajectoryGoal(joints, points), Allowed(), first)
    except GoalRejected as error:
        raise TeachError(f"the motion cannot be played; the arm has not moved: {error}") from error
    times_s = np.array([0.0, *(point.time_from_start_s for point in points)])
    position = np.array([path.position[0], *(point.positions for point in points)])
    velocity = np.array([np.zeros(len(joints)), *(point.velocities for point in points)])
    return _Leg(joints, times_s, position, velocity).approached()
