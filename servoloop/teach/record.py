"""Record a motion while a person moves the arm by hand. When the recording ends, the arm holds its position."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from enum import StrEnum
from typing import Final

import numpy as np

from controller.teach.hand_path import inside, path_of
from controller.trajectory.goal import LONGEST_GOAL_S
from drivers.printable import counted
from hal.types import FloatArray
from servoloop.api.arm import Arm
from servoloop.api.arm_errors import ArmError
from servoloop.api.backend import ArmState
from servoloop.teach.motion_files import RecordedMotion, TeachError, beyond

SOFT: Final = (
    "Torque is about to be enabled at the current position. Keep a hand on the arm. After a second the arm yields, and "
    "you can move it. Continue?"
)
HANDS_S: Final = 2.0
"""Time that the person needs to react to an instruction, in seconds."""
GAP_S: Final = 0.2
"""Maximum gap between measurements without a warning, in seconds."""
POSE_S: Final = 0.3
"""Duration of the measurements whose median defines a pose, in seconds."""
MARK_KEYS: Final = ("\n", "\r", "p")
STOP_KEYS: Final = ("\n", "\r", "q")


Keep = Callable[[RecordedMotion, Sequence[str]], None]
"""Function that saves a motion and prints its warnings. Raises DriverError if the motion cannot be saved."""


class RecordPhase(StrEnum):
    """State of a recording."""

    READYING = "getting ready: hold the arm"
    BY_HAND = "recording: move the arm"
    HOLDING = "enabling torque: hold the arm still"
    HELD = "the arm holds its position: release it"


class TeachRecording:
    """Recording of one motion, which runs in the user interface thread. The arm calls ``take`` after each cycle."""

    def __init__(self, arm: Arm, soft: bool, poses: bool, keep: Keep) -> None:
        """Prepare a recording.

        Args:
            arm: Arm to record, connected or in this process.
            soft: Whether the servos support the arm's weight. If False, the torque is disabled.
            poses: Whether to record poses marked with a key instead of the path.
            keep: Function that saves the motion.
        """
        self.phase = RecordPhase.READYING
        self.error: BaseException | None = None
        """Reason why the motion was not saved, or why it could not be reported."""
        self._arm, self._soft, self._keep = arm, soft, keep
        self._by_hand, self._watching = ExitStack(), ExitStack()
        self._poses: list[FloatArray] | None = [] if poses else None
        self._samples: list[tuple[float, FloatArray]] = []
        self._unmeasured: dict[str, None] = {}
        self._held_s = 0.0

    def begin(self) -> None:
        """Make the arm soft or limp, and start to record. Raises ArmError."""
        if self._soft:
            self._by_hand.enter_context(self._arm.freedrive())
        else:
            self._arm.torque(False, park=False)
            self._by_hand.callback(self._arm.torque, True)
        self.phase = RecordPhase.BY_HAND
        self._watching.callback(self._arm.on_state(self.take))

    def take(self, state: ArmState) -> None:
        """Record the joint positions of a cycle if all joints were measured."""
        if self.phase is not RecordPhase.BY_HAND:
            return
        position = np.array([state.position[joint] for joint in self._arm.joints])
        self._unmeasured.update(dict.fromkeys(state.unmeasured))
        if not state.unmeasured and np.isfinite(position).all():
            self._samples.append((state.time_s, position))

    def press(self, key: str) -> None:
        """Process a key, which marks the current pose or ends the recording."""
        if self._poses is not None and key in MARK_KEYS:
            if self.phase is RecordPhase.BY_HAND and self._samples:
                count = max(1, round(POSE_S * self._arm.rate_hz))
                self._poses.append(np.median([position for _, position in self._samples[-count:]], axis=0))
        elif key in STOP_KEYS:
            self.stop()

    def stop(self) -> None:
        """End and save the recording, and make the arm hold its position.

        Raises TeachError if the arm does not hold its position.
        """
        if self.phase not in (RecordPhase.READYING, RecordPhase.BY_HAND):
            return
        self.phase = RecordPhase.HOLDING
        self._watching.close()
        try:
            self._keep(*self.shown())
        except BaseException as error:  # The error is raised later, after the arm holds its position.
            self.error = error
        try:
            self._by_hand.close()
        except ArmError as error:
            how = "soft: release it" if self._soft else "limp: lay it down"
            raise TeachError(f"torque could not be enabled on all servos, and the arm is {how}. {error}") from error
        self.phase, self._held_s = RecordPhase.HELD, self._arm.state.time_s

    @property
    def status(self) -> str:
        """Text for the person: the phase or, while poses are recorded, their number and the keys."""
        if self._poses is None or self.phase is not RecordPhase.BY_HAND:
            return self.phase
        return f"recording {counted(len(self._poses), 'pose')}: press p or Enter at each pose, and q at the end"

    def update(self) -> bool:
        """Update the state. Return False once the arm has held its position for ``HANDS_S``.

        Raises TeachError if torque cannot be enabled, and ArmError if the arm can no longer be moved.
        """
        if self.phase is RecordPhase.BY_HAND and self._poses is None and self._is_full():
            self.stop()
        return not (self.phase is RecordPhase.HELD and self._arm.state.time_s - self._held_s >= HANDS_S)

    def _is_full(self) -> bool:
        """Return whether the path has reached the maximum length that can be played."""
        return bool(self._samples) and self._samples[-1][0] - self._samples[0][0] >= LONGEST_GOAL_S - 1.0

    def shown(self) -> tuple[RecordedMotion, list[str]]:
        """Return the recorded motion and warnings about it. Raises TeachError if nothing was recorded."""
        joints = self._arm.joints
        limits = [self._arm.limits[joint] for joint in joints]
        if not self._samples:
            raise TeachError("nothing was recorded")
        if self._poses is not None:
            if not self._poses:
                raise TeachError("no pose was recorded: press p or Enter at each pose, and q at the end")
            position = np.array(self._poses)
            return RecordedMotion(joints, inside(position, limits)), beyond(position, joints, limits)
        times_s = np.array([time_s for time_s, _ in self._samples])
        position = np.array([position for _, position in self._samples])
        path = path_of(times_s, position, limits)
        if path is None:
            raise TeachError("the arm was not moved: nothing was saved")
        return RecordedMotion(joints, path.position, path), self._gaps(times_s) + beyond(position, joints, limits)

    def _gaps(self, times_s: FloatArray) -> list[str]:
        """Return a warning if there are long gaps between the measurements at the times (k,)."""
        longest_s = float(np.diff(times_s).max(initial=0.0))
        if longest_s < GAP_S:
            return []
        names = ", ".join(self._unmeasured) or "the arm"
        return [f"no measurement of {names} for {longest_s:.1f} s: the path is a straight line in this gap"]
