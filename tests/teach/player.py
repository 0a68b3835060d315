"""Arm that plays a motion, and a dead-man key that the test holds."""

import numpy as np

from controller.teach.hand_path import HandPath
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import FloatArray
from servoloop.teach.motion_files import RecordedMotion
from servoloop.teach.play import Play, PlayPhase
from tests.teach.rig import FREE, RATE_HZ, SO101, Pose, Rig

FASTEST = np.array([joint.limits.velocity for joint in SO101.robot.joints])
PAN = 0


class Key:
    """Dead-man key that a test holds."""

    def __init__(self, held: bool = True) -> None:
        self.held, self.quit = held, False

    def allowed(self, now_s: float) -> bool:
        return self.held

    def ended(self) -> bool:
        return self.quit


class Player:
    """Arm that plays a motion."""

    def __init__(self, motion: RecordedMotion, speed: float = 1.0, key: Key | None = None, pose: Pose = FREE) -> None:
        self.rig = Rig(pose=pose)
        self.key = key or Key()
        self.rig.run(1.5)
        self.play = Play(self.rig.arm, motion, speed, self.key)

    def go_on(self, seconds: float = 60.0, until: PlayPhase | None = None) -> bool:
        """Run for a given time, or until the end or until a phase is reached. Return whether the playback is still
        running."""
        going = True

        def poll() -> bool:
            nonlocal going
            going = self.play.update()
            return going and self.play.phase is not until

        self.rig.run(seconds, poll)
        return going

    @property
    def reference_speeds(self) -> FloatArray:
        """Velocities (n - 1,) of the reference of the arm, without its gripper and without the compensation of lag."""
        arm = self.rig.loop.manager.registry.loaded["arm_controller"].controller
        assert isinstance(arm, JointTrajectoryController)
        return np.abs(arm.tracking.reference.velocity) if arm.tracking is not None else np.zeros(len(FASTEST) - 1)

    def speeds(self, since: int = 0) -> FloatArray:
        """Return the velocities of the commands (k, n)."""
        return np.diff(np.array(self.rig.commands[since:])[:, : len(FASTEST)], axis=0) * RATE_HZ


def path(seconds: float = 3.0, turns: float = 0.8) -> RecordedMotion:
    """Return a path of the first joint from rest to rest. The other joints keep a collision-free pose."""
    times_s = np.linspace(0.0, seconds, 60)
    position = np.tile([FREE.get(joint.name, 0.0) for joint in SO101.robot.joints], (60, 1))
    position[:, PAN] += turns * (1.0 - np.cos(np.pi * times_s / seconds)) / 2.0
    velocity = np.gradient(position, times_s, axis=0)
    velocity[[0, -1]] = 0.0
    return RecordedMotion(
        tuple(joint.name for joint in SO101.robot.joints), position, HandPath(times_s, position, velocity)
    )
