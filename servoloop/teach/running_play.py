"""Play a motion on an arm whose control loop is already running, while a key is held."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.teach.slowing import goal_points, slowed
from hal.types import FloatArray
from servoloop.api.arm import Arm
from servoloop.api.motion import ArmMotion
from servoloop.api.trajectory import ArmTrajectory
from servoloop.manual.dead_man import Permission
from servoloop.teach.play import APPROACH, PlayPhase
from servoloop.teach.taught import RecordedMotion, TeachError, check_duration

AHEAD_S: Final = 1.0
"""Maximum time by which the arm can be ahead of the time since the start of the path, in seconds."""


class RunningPlay:
    """Playback of one motion on a running arm, used in the thread of the user interface.

    When the key is released, the joints slow down within their limits and hold. When the key is held again, the arm
    moves slowly to the next point of the path and continues.
    """

    def __init__(self, arm: Arm, motion: RecordedMotion, speed: float, permission: Permission) -> None:
        """Plan the playback.

        Args:
            arm: The arm, connected or in this process.
            motion: Motion of the arm's joints, in the order of the arm.
            speed: Share of the recorded speed, from 0 to 1.
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
        """Move or stop the arm as the dead-man switch requires. Return False at the end of the motion.

        Raises:
            TeachError: The arm has stopped before the end of the motion.
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
        self.phase, self._began_s = PlayPhase.PLAYING, now_s
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
        """Stop the arm, so that the motion can continue from there later."""
        if self._running is None:
            return
        state = self._arm.state
        self._running.cancel()
        self._running, self.phase = None, PlayPhase.PAUSED
        at = np.array([state.command[joint] for joint in self._arm.joints])
        self._legs = [self._legs[0].rest(at, state.time_s - self._began_s), *self._legs[1:]]


class _Leg:
    """Part of a motion from rest to rest: a path, or a single pose."""

    def __init__(self, joints: Sequence[str], times_s: FloatArray, position: FloatArray, velocity: FloatArray) -> None:
        """Create a path with k points: times (k,), positions (k, n) and velocities (k, n)."""
        self._joints = tuple(joints)
        self._times_s, self._position, self._velocity = times_s, position, velocity

    def begin(self, arm: Arm, speed: float) -> ArmMotion:
        """Start to move along the path. The arm first moves slowly to the first point of the path."""
        if len(self._times_s) == 1:
            pose = dict(zip(self._joints, self._position[0].tolist(), strict=True))
            return arm.move_to(pose, speed=APPROACH * speed, wait=False)
        positions = {joint: self._position[:, index].tolist() for index, joint in enumerate(self._joints)}
        velocities = {joint: self._velocity[:, index].tolist() for index, joint in enumerate(self._joints)}
        times_s = (self._times_s - self._times_s[0]).tolist()
        return arm.follow(ArmTrajectory(times_s, positions, velocities), approach=APPROACH, wait=False)

    def rest(self, at: FloatArray, passed_s: float) -> "_Leg":
        """Return the rest of the path from the point that is nearest to a position (n,).

        ``passed_s`` is the time since the start of the motion, including the way to the first point.
        """
        reachable = self._times_s - self._times_s[0] <= passed_s + AHEAD_S
        distance = np.abs(self._position - at).max(axis=1)
        first = int(np.argmin(np.where(reachable, distance, np.inf)))
        return _Leg(self._joints, self._times_s[first:], self._position[first:], self._velocity[first:])


def _legs(arm: Arm, motion: RecordedMotion, speed: float) -> list[_Leg]:
    """Return the parts of a motion. Raises TeachError if the motion takes too long."""
    joints, limits = arm.joints, [arm.limits[joint] for joint in arm.joints]
    if motion.path is None:
        rest = np.zeros((1, len(joints)))
        return [_Leg(joints, np.zeros(1), pose[None, :], rest) for pose in motion.position]
    check_duration(motion.path.duration_s / speed, "the motion")
    path = slowed(motion.path, limits, speed)
    points = goal_points(path, limits)
    times_s = np.array([0.0, *(point.time_from_start_s for point in points)])
    position = np.array([path.position[0], *(point.positions for point in points)])
    velocity = np.array([np.zeros(len(joints)), *(point.velocities for point in points)])
    return [_Leg(joints, times_s, position, velocity)]
