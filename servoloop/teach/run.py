"""Recording and playing from start to end: the loop in its thread, the person at the terminal in this one."""

import time
from collections.abc import Callable, Sequence
from types import TracebackType
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
from servoloop.teach.record import Keep, Recording
from servoloop.teach.taught import Taught
from servoloop.teleop.arms import Side

Show = Callable[[str, TeachArm], None]
"""Shows what the arm does, many times a second."""


class Person(Protocol):
    """Whoever has the arm in their hands; within its context at the keys, and looking on."""

    def confirm(self, question: str) -> None:
        """Raises where the answer is not yes."""
        ...

    def __enter__(self) -> object: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
    def pressed(self) -> Sequence[str]:
        """Those that were pressed since the last look; never waits."""
        ...

    def show(self, phase: str, arm: TeachArm) -> None:
        """Show what the arm does; called many times a second."""
        ...


def record(side: Side, rate_hz: int, limp: bool, poses: bool, person: Person, keep: Keep) -> int:
    """Record until a key, a signal or a fault ends it; the exit status. ``keep`` is given what was shown before
    torque comes back.

    The arm ends held or parked, as its robot file says; where torque cannot come back it stays as it is, in somebody's
    hands. Raises what kept it from being made limp or soft or from holding itself, and TeachError where nothing was
    shown.
    """
    worker, told, looked_at = BackgroundWorker(), Signals(), StackRecording(None)
    arm = build_arm(side, rate_hz, MonotonicClock(), worker, not limp, looked_at.tap)
    recording = Recording(arm, None if limp else add_freedrive(arm), poses, keep)
    arm.loop.on_cycle = recording.take
    run = LoopThread(arm.stack, told)
    with arm.stack.configured(hangs=run.hangs):
        recording.ask(person.confirm)  # until here a signal ends the program at once, and nothing has changed
        with Signals(LEFT) as signals, person:

            def look() -> None:
                for key in person.pressed():
                    recording.press(key)
                if signals.count:
                    recording.stop()
                if signals.count > 1:
                    told.count = signals.count
                if not recording.look(time.monotonic()):
                    told.ask()
                person.show(recording.phase, arm)

            try:
                _attend(arm, run, looked_at, recording.begin, look)
            finally:
                recording.stop()  # whatever has ended it leaves what there is
    if recording.error is not None:
        raise recording.error
    return 1 if run.failed else 0


def play(side: Side, rate_hz: int, taught: Taught, speed: float, permission: Permission, show: Show) -> int:
    """Play a motion of the arm's joints, ``speed`` (0 to 1) times as fast as it was shown; the exit status.

    The arm ends held or parked, as its robot file says. Raises as bringing up an arm does, and TeachError.
    """
    worker, looked_at = BackgroundWorker(), StackRecording(None)
    arm = build_arm(side, rate_hz, MonotonicClock(), worker, tap=looked_at.tap)
    playing = Play(arm, add_trajectory(arm), taught, speed, permission)
    with Signals(LEFT) as signals:
        run = LoopThread(arm.stack, signals)

        def look() -> None:
            if not playing.look(time.monotonic()):
                signals.ask()
            show(playing.phase, arm)

        with arm.stack.configured(hangs=run.hangs):
            _attend(arm, run, looked_at, playing.begin, look)
    return 1 if run.failed else 0


def _attend(
    arm: TeachArm, run: LoopThread, looked_at: StackRecording, begin: Callable[[], None], look: Callable[[], None]
) -> None:
    """The loop runs until it is told to end; who looks on finds it meanwhile. Raises what ``begin`` and ``look`` do."""
    offset_s = wall_offset_s(arm.loop.clock, time.time)
    with looked_at.of(arm.loop, arm.files, offset_s, lambda: run.failed):
        claim_realtime_priority()
        begin()
        run_beside(run, look)
