"""Record a motion while a person moves the arm by hand. At the end the arm holds its position."""

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Final

import numpy as np

from controller.manager.requests import Request
from controller.teach.freedrive_controller import FreedriveController
from controller.teach.hand_path import inside, path_of
from controller.trajectory.goal import LONGEST_GOAL_S
from drivers.errors import DriverError
from hal.errors import HalError
from hal.lifecycle import LifecycleState
from hal.servos.limp_arm import release_question
from hal.types import FloatArray, JointState
from servoloop.teach.arm import ARM, TeachArm
from servoloop.teach.taught import RecordedMotion, TeachError, beyond

SOFT: Final = (
    "Torque is about to be enabled softly at the current position. Keep a hand on the arm. After a second you can move "
    "it. Continue?"
)
HANDS_S: Final = 2.0
"""Time for the person to react to an instruction, in seconds."""
GAP_S: Final = 0.2
"""Longest gap in the measurements that is accepted without a warning, in seconds."""
POSE_S: Final = 0.3
"""Time over which a pose is averaged (median), in seconds."""
MARK_KEYS: Final = ("\n", "\r", "p")
STOP_KEYS: Final = ("\n", "\r", "q")


Keep = Callable[[RecordedMotion, Sequence[str]], None]
"""Function that saves a motion and prints the warnings about it. Raises DriverError if it cannot be saved."""


class RecordPhase(StrEnum):
    """State of a recording."""

    READYING = "getting ready: hold the arm"
    BY_HAND = "recording: move the arm"
    HOLDING = "enabling torque: hold the arm still"
    HELD = "the arm holds its position: release it"


class TeachRecording:
    """Recording of one motion. The loop thread calls ``take``; the user interface calls all other methods."""

    def __init__(self, arm: TeachArm, freedrive: FreedriveController | None, poses: bool, keep: Keep) -> None:
        """Prepare a recording.

        Args:
            arm: Arm to record.
            freedrive: Freedrive controller of a soft arm. None: the arm is limp.
            poses: Whether to record poses marked with a key instead of the path.
            keep: Function that saves the motion.
        """
        self.phase = RecordPhase.READYING
        self.error: Exception | None = None
        """Reason why the motion was not saved."""
        self._arm, self._freedrive, self._keep = arm, freedrive, keep
        self._poses: list[FloatArray] | None = [] if poses else None
        self._samples: list[tuple[float, FloatArray]] = []
        self._unmeasured: dict[str, None] = {}
        self._back: Request[None] | None = None
        self._held_s = 0.0

    def ask(self, confirm: Callable[[str], None]) -> None:
        """Ask the person to hold the arm if necessary. ``confirm`` raises an error if the person refuses."""
        if self._freedrive is not None:
            confirm(SOFT)
        elif servos := self._arm.hardware.held():
            confirm(release_question(servos))

    def begin(self) -> None:
        """Make the arm limp or soft."""
        if self._freedrive is not None:
            self._arm.loop.activate()
        else:
            self._arm.hardware.release()
            self._arm.loop.activate(keep_inactive=[ARM])

    def take(self, state: JointState) -> None:
        """Record the joint positions of a cycle if all joints were measured."""
        if self.phase is not RecordPhase.BY_HAND:
            return
        self._unmeasured.update(dict.fromkeys(state.faults))
        if not state.faults and np.isfinite(state.position).all():
            self._samples.append((state.stamp_s, state.position.copy()))

    def press(self, key: str) -> None:
        """Process a key, which marks the current pose or ends the recording."""
        if self._poses is not None and key in MARK_KEYS:
            if self.phase is RecordPhase.BY_HAND and self._samples:
                count = max(1, round(POSE_S / self._arm.loop.period_s))
                self._poses.append(np.median([position for _, position in self._samples[-count:]], axis=0))
        elif key in STOP_KEYS:
            self.stop()

    def stop(self) -> None:
        """End and save the recording, and make the arm hold its position."""
        if self.phase not in (RecordPhase.READYING, RecordPhase.BY_HAND):
            return
        self.phase = RecordPhase.HOLDING
        try:
            self._keep(*self.shown())
        except DriverError as error:  # The error is raised later, once the arm holds its position.
            self.error = error
        if self._freedrive is not None:
            self._freedrive.holds = True
        else:
            self._back = self._arm.loop.component_transitions.ask(ARM, LifecycleState.ACTIVE)

    def update(self, now_s: float) -> bool:
        """Update the state. Return False once the arm has held its position for ``HANDS_S``.

        Raises TeachError if torque cannot be enabled.
        """
        if self.phase is RecordPhase.READYING and (self._freedrive is None or self._freedrive.free):
            self.phase = RecordPhase.BY_HAND
        elif self.phase is RecordPhase.BY_HAND and self._poses is None and self._is_full():
            self.stop()
        elif self.phase is RecordPhase.HOLDING and self._holds():
            self.phase, self._held_s = RecordPhase.HELD, now_s
        return not (self.phase is RecordPhase.HELD and now_s - self._held_s >= HANDS_S)

    def _is_full(self) -> bool:
        """Return whether the path has reached the maximum length for playback."""
        return bool(self._samples) and self._samples[-1][0] - self._samples[0][0] >= LONGEST_GOAL_S - 1.0

    def _holds(self) -> bool:
        """Return whether torque is enabled again, with the goals at the measured positions."""
        if self._freedrive is not None and self._back is None and self._freedrive.held:
            self._back = self._arm.loop.requests.ask(self._arm.hardware.restore_torque_limits)
        if self._back is None or not self._back.done:
            return False
        try:
            self._back.result()
        except (DriverError, HalError) as error:
            how = "limp: lay it down" if self._freedrive is None else "soft: release it"
            raise TeachError(f"torque could not be enabled on all servos, and the arm is {how}. {error}") from error
        return True

    def shown(self) -> tuple[RecordedMotion, list[str]]:
        """Return the recorded motion and warnings about it. Raises TeachError if nothing was recorded."""
        joints, limits = self._arm.joints, self._arm.loop.limits
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
        """Return a warning if the measurements at the times (k,) have long gaps."""
        longest_s = float(np.diff(times_s).max(initial=0.0))
        if longest_s < GAP_S:
            return []
        names = ", ".join(self._unmeasured) or "the arm"
        return [f"{names} not measured for {longest_s:.1f} s: the path is a straight line in this gap"]
