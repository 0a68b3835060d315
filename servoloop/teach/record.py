"""Recording: an arm in somebody's hands is measured, and in the end holds itself where it was left."""

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
from servoloop.teach.taught import Taught, TeachError, beyond

SOFT: Final = "Torque goes on softly, where the arm is: have a hand at it. In a second it gives way to you. Go on?"
HANDS_S: Final = 2.0
"""So long hands may need to do what they were told."""
GAP_S: Final = 0.2
"""A hand goes straight on for so long."""
POSE_S: Final = 0.3
"""A pose is the middle of where the joints were in this time."""
MARK_KEYS: Final = ("\n", "\r", "p")
STOP_KEYS: Final = ("\n", "\r", "q")


Keep = Callable[[Taught, Sequence[str]], None]
"""Is given what was shown, and in words what is wrong with it. Raises DriverError where it cannot be kept."""


class Phase(StrEnum):
    """What the arm does."""

    READYING = "getting ready: hold the arm"
    BY_HAND = "recording: move the arm"
    HOLDING = "torque comes back: hold the arm still"
    HELD = "the arm holds itself: let it go"


class Recording:
    """One recording. ``take`` is called in the loop's thread, all else in the person's."""

    def __init__(self, arm: TeachArm, freedrive: FreedriveController | None, poses: bool, keep: Keep) -> None:
        """``freedrive``: of a soft arm, None where it is limp. ``poses``: those that are marked, and not the path."""
        self.phase = Phase.READYING
        self.error: Exception | None = None
        """Why nothing was kept."""
        self._arm, self._freedrive, self._keep = arm, freedrive, keep
        self._poses: list[FloatArray] | None = [] if poses else None
        self._samples: list[tuple[float, FloatArray]] = []
        self._unmeasured: dict[str, None] = {}
        self._back: Request[None] | None = None
        self._held_s = 0.0

    def ask(self, confirm: Callable[[str], None]) -> None:
        """Have somebody hold the arm, where that is needed; ``confirm`` raises where they do not. Raises errors."""
        if self._freedrive is not None:
            confirm(SOFT)
        elif servos := self._arm.hardware.held():
            confirm(release_question(servos))

    def begin(self) -> None:
        """Make the arm limp or soft. Raises errors."""
        if self._freedrive is not None:
            self._arm.loop.activate()
        else:
            self._arm.hardware.release()
            self._arm.loop.activate(keep_inactive=[ARM])

    def take(self, state: JointState) -> None:
        """Note where the joints are, if all of them were measured."""
        if self.phase is not Phase.BY_HAND:
            return
        self._unmeasured.update(dict.fromkeys(state.faults))
        if not state.faults and np.isfinite(state.position).all():
            self._samples.append((state.stamp_s, state.position.copy()))

    def press(self, key: str) -> None:
        """A key: one keeps the pose in which the arm is, another ends the recording."""
        if self._poses is not None and key in MARK_KEYS:
            if self.phase is Phase.BY_HAND and self._samples:
                count = max(1, round(POSE_S / self._arm.loop.period_s))
                self._poses.append(np.median([position for _, position in self._samples[-count:]], axis=0))
        elif key in STOP_KEYS:
            self.stop()

    def stop(self) -> None:
        """End the recording, and keep it: the arm is to hold itself."""
        if self.phase not in (Phase.READYING, Phase.BY_HAND):
            return
        self.phase = Phase.HOLDING
        try:
            self._keep(*self.shown())
        except DriverError as error:  # first the arm
            self.error = error
        if self._freedrive is not None:
            self._freedrive.holds = True
        else:
            self._back = self._arm.loop.component_transitions.ask(ARM, LifecycleState.ACTIVE)

    def look(self, now_s: float) -> bool:
        """Go on; False once the arm has held itself for a while. Raises what keeps it from that."""
        if self.phase is Phase.READYING and (self._freedrive is None or self._freedrive.free):
            self.phase = Phase.BY_HAND
        elif self.phase is Phase.BY_HAND and self._poses is None and self._is_full():
            self.stop()
        elif self.phase is Phase.HOLDING and self._holds():
            self.phase, self._held_s = Phase.HELD, now_s
        return not (self.phase is Phase.HELD and now_s - self._held_s >= HANDS_S)

    def _is_full(self) -> bool:
        """Whether a longer path could not be played."""
        return bool(self._samples) and self._samples[-1][0] - self._samples[0][0] >= LONGEST_GOAL_S - 1.0

    def _holds(self) -> bool:
        """Whether torque is back, with the goals where the joints are."""
        if self._freedrive is not None and self._back is None and self._freedrive.held:
            self._back = self._arm.loop.requests.ask(self._arm.hardware.restore_torque_limits)
        if self._back is None or not self._back.done:
            return False
        try:
            self._back.result()
        except (DriverError, HalError) as error:
            how = "limp: put it down" if self._freedrive is None else "soft: let it go"
            raise TeachError(f"not all torque comes back, and the arm is {how}. {error}") from error
        return True

    def shown(self) -> tuple[Taught, list[str]]:
        """What was shown, and what is wrong with it. Raises TeachError where nothing was."""
        joints, limits = self._arm.joints, self._arm.loop.limits
        if not self._samples:
            raise TeachError("nothing was recorded")
        if self._poses is not None:
            if not self._poses:
                raise TeachError("no pose was kept: press p or Enter at each, and q at the end")
            position = np.array(self._poses)
            return Taught(joints, inside(position, limits)), beyond(position, joints, limits)
        times_s = np.array([time_s for time_s, _ in self._samples])
        position = np.array([position for _, position in self._samples])
        path = path_of(times_s, position, limits)
        if path is None:
            raise TeachError("the arm was not moved: nothing is kept")
        return Taught(joints, path.position, path), self._gaps(times_s) + beyond(position, joints, limits)

    def _gaps(self, times_s: FloatArray) -> list[str]:
        """In words, where too little was measured (at the times (k,)) to know the way."""
        longest_s = float(np.diff(times_s).max(initial=0.0))
        if longest_s < GAP_S:
            return []
        names = ", ".join(self._unmeasured) or "the arm"
        return [f"{names} not measured for {longest_s:.1f} s: the path is straight there"]
