"""What a running stack's live feed says of its robot, for who moves it."""

import threading
from collections.abc import Mapping
from pathlib import Path
from time import monotonic
from typing import Final, Self

import numpy as np

from hal.robot_description.description import parse_urdf
from hal.types import FloatArray, JointLimits
from nodes.handling.robot import HandlingError, JointsNow
from servoloop.recording.history import Curves
from servoloop.recording.robot_state import RobotState, Snapshot, servo_faults
from servoloop.recording.sources import LiveSource
from servoloop.recording.stream import find_stack, open_live

ANSWER_S: Final = 5.0


def joints_now(snapshot: Snapshot, age_s: float) -> JointsNow:
    """The joints as a snapshot has them."""
    commanded = np.where(np.isfinite(snapshot.command), snapshot.command, snapshot.position)
    return JointsNow(
        _by_name(snapshot, commanded), _by_name(snapshot, snapshot.position), age_s, servo_faults(snapshot)
    )


def _by_name(snapshot: Snapshot, positions: FloatArray) -> dict[str, float]:
    return dict(zip(snapshot.joints, positions.tolist(), strict=True))


def limits_of(snapshot: Snapshot) -> dict[str, JointLimits]:
    """The limits of the robot description, by joint."""
    if not snapshot.description_xml:
        return {}
    joints = parse_urdf(snapshot.description_xml).joints
    return {
        name: JointLimits(joint.lower, joint.upper, joint.velocity, np.inf, np.inf)
        for name, joint in joints.items()
        if name in snapshot.joints
    }


class LiveRobot:
    """A robot whose stack runs on this machine; a thread reads its feed."""

    def __init__(self, arm: str | None = None) -> None:
        """``arm``: the name or folder, where several run. Raises LiveError where none does."""
        found = find_stack(arm)
        self.arm = found.arm
        self._folder = found.folder
        self._state = RobotState()
        self._heard_s = -np.inf
        self._complete = threading.Event()
        self._limits: dict[str, JointLimits] | None = None
        self._stream = open_live(found)
        threading.Thread(target=self._read, name="live feed", daemon=True).start()

    @property
    def snapshot(self) -> Snapshot:
        """The robot as it is now."""
        return self._state.snapshot

    @property
    def curves(self) -> Curves:
        """The last minute."""
        return self._state.curves()

    @property
    def folder(self) -> Path:
        """The arm's own folder. Raises HandlingError if the stack has not said it."""
        if self._folder is None:
            raise HandlingError(f"the stack of {self.arm} does not tell its arm's folder: its poses are not known")
        return self._folder

    @property
    def limits(self) -> Mapping[str, JointLimits]:
        """By joint, as the robot description says."""
        if self._limits is None:
            self._limits = limits_of(self.snapshot)
        return self._limits

    def joints_now(self) -> JointsNow:
        """The joints as the stack has told last."""
        return joints_now(self.snapshot, monotonic() - self._heard_s)

    def wait(self) -> None:
        """Wait for the first measurement. Raises HandlingError where none comes."""
        if not self._complete.wait(ANSWER_S):
            raise HandlingError(f"the stack of {self.arm} has measured nothing for {ANSWER_S:.0f} s")

    def close(self) -> None:
        """End."""
        self._stream.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self) -> None:
        for received in self._stream:
            self._state.take(received)
            if received.topic == "/servoloop/commands":
                self._heard_s = monotonic()
                self._complete.set()


class WatchedRobot:
    """The robot of a source that follows a running stack."""

    def __init__(self, source: LiveSource) -> None:
        self._source = source
        self._xml = ""
        self._limits: dict[str, JointLimits] = {}

    @property
    def limits(self) -> Mapping[str, JointLimits]:
        """By joint, as the robot description says."""
        snapshot = self._source.watched.state.snapshot
        if snapshot.description_xml != self._xml:
            self._limits, self._xml = limits_of(snapshot), snapshot.description_xml
        return self._limits

    def joints_now(self) -> JointsNow:
        """The joints as the stack has told last."""
        return joints_now(self._source.watched.state.snapshot, self._source.silent_s)
