"""Run a recording or a playback from start to end.

The loop has its own thread; the user interface runs in the calling thread.
"""

import time
from collections.abc import Callable, Sequence
from typing import Protocol

from drivers.clock import MonotonicClock, wall_offset_s
from servoloop.manual.dead_man import Permission
from servoloop.recording.stack_recording import StackRecording
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.loop_thread import LEFT, LoopThread, run_beside
from servoloop.stack.processes import claim_realtime_priority
from servoloop.stack.signals import Signals
from servoloop.teach.arm import TeachArm, add_freedrive, add_trajectory, build_arm
from servoloop.teach.play import Play
from servoloop.teach.record import Keep, TeachRecording
from servoloop.teach.taught import RecordedMotion
from servoloop.teleop.arms import Side

Show = Callable[[str, TeachArm], None]
"""Function that displays the state of the arm. It is called many times per second."""


class TeachOperator(Protocol):
    """User interface of a recording. Within the context of the interface, keys are read and the arm is displayed."""

    def confirm(self, question: str) -> None:
        """Ask a question. Raise an error unless the answer is yes."""
        ...

    def __enter__(self) -> object: ...
    def __exit__(self, *_: object) -> None: ...
    def pressed(self) -> Sequence[str]:
        """Return the keys pressed since the last call, without waiting."""
        ...

    def show(self, phase: str, arm: TeachArm) -> None:
        """Display the state of the arm. The method is called many times per second."""
        ...


def record(side: Side, rate_hz: int, limp: bool, poses: bool, person: TeachOperator, keep: Keep) -> int:
    """Record a motion until a key, a signal or a fault ends the recording.

    At the end, the arm holds its position or parks, as its robot file requires. If torque cannot be enabled, the arm
    stays limp or soft, and the person must hold it.

    Args:
        side: Files and devices of the arm.
        rate_hz: Rate of the loop.
        limp: Whether to record a limp arm instead of a soft arm.
        poses: Whether to record marked poses instead of the path.
        person: User interface.
        keep: Function that saves the motion. The function is called before torque is enabled again.

    Returns:
        Exit status.

    Raises:
        TeachError: Nothing was recorded, or torque could not be enabled on all servos.
        DriverError, HalError: The arm could not be made limp or soft.
    """
    worker, loop_signals, stack_recording = BackgroundWorker(), Signals(), StackRecording(None)
    arm = build_arm(side, rate_hz, MonotonicClock(), worker, not limp, stack_recording.tap)
    recording = TeachRecording(arm, None if limp else add_freedrive(arm), poses, keep)
    arm.loop.on_cycle = recording.take
    run = LoopThread(arm.stack, loop_signals)
    with arm.stack.configured(hangs=run.hangs):
        recording.ask(person.confirm)  # a signal before this point ends the program at once, with the arm unchanged
        with Signals(LEFT) as signals, person:

            def poll() -> None:
                for key in person.pressed():
                    recording.press(key)
                if signals.count:
                    recording.stop()
                if signals.count > 1:
                    loop_signals.count = signals.count
                if not recording.update(time.monotonic()):
                    loop_signals.ask()
                person.show(recording.phase, arm)

            try:
                _run(arm, run, stack_recording, recording.begin, poll)
            finally:
                recording.stop()  # This saves the motion even after an error.
    if recording.error is not None:
        raise recording.error
    return 1 if run.failed else 0


def play(side: Side, rate_hz: int, motion: RecordedMotion, speed: float, permission: Permission, show: Show) -> int:
    """Play a motion of the arm's joints.

    At the end, the arm holds its position or parks, as its robot file requires.

    Args:
        side: Files and devices of the arm.
        rate_hz: Rate of the loop.
        motion: Motion to play.
        speed: Share of the recorded speed, from 0 to 1.
        permission: Dead-man switch.
        show: Function that displays the state of the arm.

    Returns:
        Exit status.

    Raises:
        TeachError: The motion cannot be played.
        DriverError, HalError: The arm cannot be activated.
    """
    worker, stack_recording = BackgroundWorker(), StackRecording(None)
    arm = build_arm(side, rate_hz, MonotonicClock(), worker, tap=stack_recording.tap)
    playing = Play(arm, add_trajectory(arm), motion, speed, permission)
    with Signals(LEFT) as signals:
        run = LoopThread(arm.stack, signals)

        def poll() -> None:
            if not playing.update(time.monotonic()):
                signals.ask()
            show(playing.phase, arm)

        with arm.stack.configured(hangs=run.hangs):
            _run(arm, run, stack_recording, playing.begin, poll)
    return 1 if run.failed else 0


def _run(
    arm: TeachArm, run: LoopThread, recording: StackRecording, begin: Callable[[], None], poll: Callable[[], None]
) -> None:
    """Call ``begin``, then run the loop and call ``poll`` until the end, while the live feed is served."""
    offset_s = wall_offset_s(arm.loop.clock, time.time)
    with recording.of(arm.loop, arm.files, offset_s, lambda: run.failed):
        claim_realtime_priority()
        begin()
        run_beside(run, poll)
