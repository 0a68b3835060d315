"""Arm that plays a motion, and a dead-man key that the test holds."""

import numpy as np

from controller.teach.hand_path import HandPath
from hal.types import FloatArray
from servoloop.teach.arm import add_trajectory
from servoloop.teach.play import Play, PlayPhase
from servoloop.teach.taught import RecordedMotion
from tests.teach.rig import FREE, SO101, Pose, Rig

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

    def __init__(self, taught: RecordedMotion, speed: float = 1.0, key: Key | None = None, pose: Pose = FREE) -> None:
        self.rig = Rig(pose=pose)
        self.key = key or Key()
        self.follow = add_trajectory(self.rig.arm)
        self.play = Play(self.rig.arm, self.follow, taught, speed, self.key)
        self.speeds: list[FloatArray] = []
        """Velocities (n,) of the references."""
        self.rig.configure()
        self.play.begin()

    def go_on(self, seconds: float = 60.0, until: PlayPhase | None = None) -> bool:
        """Run for a given time, or until the end or until a phase is reached. Return whether the playback is still
        running."""
        going = True

        def poll() -> bool:
            nonlocal going
            if self.follow.tracking is not None:
                self.speeds.append(self.follow.tracking.reference.velocity)
            going = self.play.update(self.rig.clock.now())
            return going and self.play.phase is not until

        self.rig.run(seconds, poll)
        return going


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
