"""Robot of a running stack, for programs that control it manually."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final, Self

import numpy as np

from drivers.clock import MonotonicClock
from hal.robot_description.description import parse_urdf
from hal.types import FloatArray, JointLimits
from servoloop.manual.joints_now import HandlingError, JointsNow
from servoloop.recording.history import Curves
from servoloop.recording.robot_state import RobotSnapshot, servo_faults
from servoloop.recording.sources import LiveSource
from servoloop.recording.stream import RunningStack

ANSWER_S: Final = 5.0
"""Maximum time until the first measurement of a running stack arrives, in seconds."""


def joints_now(snapshot: RobotSnapshot, age_s: float) -> JointsNow:
    """Return the commanded and measured joint positions from a snapshot that is ``age_s`` old."""
    commanded = np.where(np.isfinite(snapshot.command), snapshot.command, snapshot.position)
    return JointsNow(
        _by_name(snapshot, commanded), _by_name(snapshot, snapshot.position), age_s, servo_faults(snapshot)
    )


def _by_name(snapshot: RobotSnapshot, positions: FloatArray) -> dict[str, float]:
    return dict(zip(snapshot.joints, positions.tolist(), strict=True))


def limits_of(snapshot: RobotSnapshot) -> dict[str, JointLimits]:
    """Return the limits in the robot description, keyed by joint name."""
    if not snapshot.description_xml:
        return {}
    joints = parse_urdf(snapshot.description_xml).joints
    return {
        name: JointLimits(joint.lower, joint.upper, joint.velocity, np.inf, np.inf)
        for name, joint in joints.items()
        if name in snapshot.joints
    }


class LiveRobot:
    """Robot of a running stack on this machine, with the state from the stack's live feed."""

    def __init__(self, source: LiveSource) -> None:
        self._source = source
        self._description_xml = ""
        self._limits: dict[str, JointLimits] = {}

    @classmethod
    def find(cls, arm: str | None = None, namespace: str | None = None) -> Self:
        """Receive the state of a running stack.

        Args:
            arm: Name or folder of the arm, or None for any arm.
            namespace: ROS namespace of the stack; empty for the root namespace or None for any namespace.

        Raises:
            LiveError: There is no such running stack.
        """
        return cls(LiveSource(arm, MonotonicClock(), namespace))

    @property
    def arm(self) -> str:
        """Name of the arm."""
        return self._source.arm

    @property
    def stack(self) -> RunningStack:
        """The running stack."""
        return self._source.stack

    @property
    def snapshot(self) -> RobotSnapshot:
        """Latest state of the robot."""
        return self._source.robot.state.snapshot

    @property
    def curves(self) -> Curves:
        """Joint states of the last minute."""
        return self._source.robot.state.curves()

    @property
    def folder(self) -> Path:
        """Folder of the arm. Raises HandlingError if the stack has not reported the folder."""
        if self._source.folder is None:
            raise HandlingError(
                f"the poses of {self.arm} are unknown because its stack does not report the arm's folder"
            )
        return self._source.folder

    @property
    def limits(self) -> Mapping[str, JointLimits]:
        """Limits in the robot description, keyed by joint name."""
        snapshot = self.snapshot
        if snapshot.description_xml != self._description_xml:
            self._limits, self._description_xml = limits_of(snapshot), snapshot.description_xml
        return self._limits

    def joints_now(self) -> JointsNow:
        """Return the joint positions and faults that the stack reported most recently, with their age."""
        return joints_now(self.snapshot, self._source.silent_s)

    def wait(self) -> None:
        """Wait for the first measurement. Raises HandlingError if no measurement arrives within ``ANSWER_S``."""
        if not self._source.has_state.wait(ANSWER_S):
            raise HandlingError(f"the stack of {self.arm} has not sent any measurements for {ANSWER_S:.0f} s")

    def close(self) -> None:
        """Stop receiving the stack's state."""
        self._source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
