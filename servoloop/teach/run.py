"""Run a recording or a playback from start to end, in the user interface thread."""

from collections.abc import Sequence
from typing import Final, Protocol

from servoloop.api.arm import Arm
from servoloop.manual.dead_man import Permission
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import Signals
from servoloop.teach.motion_files import RecordedMotion
from servoloop.teach.play import Play, PlayPhase
from servoloop.teach.record import Keep, TeachRecording

POLL_S: Final = 0.02
"""Period at which the keys are checked, in seconds."""


class TeachScreen(Protocol):
    """Display of the arm, within its context."""

    def __enter__(self) -> object: ...
    def __exit__(self, *_: object) -> None: ...
    def show(self, phase: str, arm: Arm) -> None:
        """Display the state of the arm. The method is called many times per second."""
        ...


class TeachOperator(TeachScreen, Protocol):
    """User interface of a recording, which reads keys while its context is active."""

    def pressed(self) -> Sequence[str]:
        """Return the keys pressed since the last call, without waiting."""
        ...


def record(arm: Arm, limp: bool, poses: bool, person: TeachOperator, keep: Keep) -> None:
    """Record a motion until a key, a signal or a fault ends the recording. The arm then holds its position.

    If torque cannot be enabled, the arm stays limp or soft, and the person must hold it.

    Args:
        arm: Arm to record, with its torque enabled.
        limp: Whether to record a limp arm instead of a soft arm.
        poses: Whether to record marked poses instead of the path.
        person: User interface.
        keep: Function that saves the motion. The function is called before torque is enabled again.

    Raises:
        TeachError: Nothing was recorded, or torque could not be enabled on all servos.
        ArmError: The arm could not be made limp or soft, or it can no longer be moved.
    """
    recording = TeachRecording(arm, not limp, poses, keep)
    with Signals() as signals, person:
        try:
            person.show(recording.status, arm)
            recording.begin()
            while recording.update() and signals.count < 2:
                for key in person.pressed():
                    recording.press(key)
                if signals.count:
                    recording.stop()
                person.show(recording.status, arm)
                arm.sleep(POLL_S)
        finally:
            recording.stop()  # The motion is saved even after an error.
    if recording.error is not None:
        raise recording.error


def play(arm: Arm, motion: RecordedMotion, speed: float, permission: Permission, screen: TeachScreen) -> bool:
    """Play a motion of the arm's joints. The arm then holds its position.

    Args:
        arm: Arm that plays the motion, with its torque enabled.
        motion: Motion to play.
        speed: Fraction of the recorded speed, from 0 to 1.
        permission: Dead-man switch.
        screen: Display of the arm.

    Returns:
        Whether the motion was completed; False if the person ended it before.

    Raises:
        TeachError: The motion cannot be played, or the arm stopped before the end of the motion.
        ArmError: The arm cannot be moved.
        Interrupted: A signal stopped the playback.
    """
    with Signals() as signals, screen:
        playing = Play(arm, motion, speed, permission)
        while playing.update():
            if signals.count:
                arm.stop()
                raise Interrupted("interrupted; the arm has stopped")
            screen.show(playing.phase, arm)
            arm.sleep(POLL_S)
        screen.show(playing.phase, arm)
    return playing.phase is PlayPhase.DONE
