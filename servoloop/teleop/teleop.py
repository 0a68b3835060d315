"""Run teleoperation from start to end. The loop has its own thread; the user interface runs in the calling thread."""

import time
from dataclasses import replace
from typing import Protocol

from drivers.clock import MonotonicClock, wall_offset_s
from hal.servos.leader_arm import LEADER
from servoloop.recording.stack_recording import StackRecording
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.loop_thread import LEFT, LoopThread, run_beside
from servoloop.stack.processes import claim_realtime_priority
from servoloop.stack.signals import Signals
from servoloop.teleop.arms import Side, Teleop, build_teleop, release_leader
from servoloop.teleop.attendance import Attendance, TeleopOperator


class Leading(TeleopOperator, Protocol):
    """Terminal user interface. While the context of the interface is active, keys are read and the arms are
    displayed."""

    def confirm(self, question: str) -> None:
        """Ask a question. Raise an error unless the answer is yes."""
        ...

    def __enter__(self) -> object: ...
    def __exit__(self, *_: object) -> None: ...


def teleop(leader: Side, follower: Side, rate_hz: int, person: Leading) -> int:
    """Run teleoperation until a signal, a key or a fault ends it.

    If torque is enabled on the leader, it is disabled only after the user confirms. When teleoperation ends, the
    follower holds its position or parks, as its robot file requires, and the leader stays limp. The live feed shows
    both arms under the follower's name.

    Args:
        leader: Files and devices of the leader.
        follower: Files and devices of the follower.
        rate_hz: Rate of the loop.
        person: User interface.

    Returns:
        Exit status.

    Raises:
        TeleopError: The arms cannot be used as leader and follower.
        DriverError, HalError: An arm cannot be activated.
    """
    files = replace(follower.files, controllers=replace(follower.files.controllers, update_rate_hz=rate_hz))
    clock, worker, recording = MonotonicClock(), BackgroundWorker(), StackRecording(None)
    both = build_teleop(leader, replace(follower, files=files), clock, worker, recording.tap)
    stack, loop, signals = both.stack, both.loop, Signals(LEFT)
    run = LoopThread(stack, signals)
    with stack.configured(hangs=run.hangs):
        release_leader(both, person.confirm)  # until this point, a signal ends the program immediately
        with signals, person:
            claim_realtime_priority()
            with recording.of(loop, files, wall_offset_s(clock, time.time), lambda: run.failed, stack.setup.scene):
                loop.activate(keep_inactive=[LEADER])
                _run(run, both, person)
    return 1 if run.failed or both.lost else 0


def _run(run: LoopThread, both: Teleop, person: TeleopOperator) -> None:
    """Run the loop in its thread and supervise the arms in this thread."""
    attendance = Attendance(both, person, run.signals.ask)
    try:
        run_beside(run, lambda: attendance.update(time.monotonic()))
    finally:
        both.controller.allowed = False
