"""One teleoperation from start to end: the loop in its thread, the person at the terminal in this one."""

import time
from dataclasses import replace
from types import TracebackType
from typing import Protocol

from drivers.clock import MonotonicClock, wall_offset_s
from hal.servos.leader_arm import LEADER
from servoloop.recording.stack_recording import StackRecording
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.loop_thread import LEFT, LoopThread, run_beside
from servoloop.stack.processes import claim_realtime_priority
from servoloop.stack.signals import Signals
from servoloop.teleop.arms import Side, Teleop, build_teleop, release_leader
from servoloop.teleop.attendance import Attendance, Person


class Leading(Person, Protocol):
    """The person at the terminal. Within the context their keys are read and the arms are shown."""

    def confirm(self, question: str) -> None:
        """Raise an error unless the answer is yes."""
        ...

    def __enter__(self) -> object: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


def teleop(leader: Side, follower: Side, rate_hz: int, person: Leading) -> int:
    """Let the follower follow until a signal, the person's key, or a fault; the exit status.

    A leader that holds torque is released only if the person agrees. The follower ends held or parked, as its robot
    file says, and the leader as it is, limp. Viewers find both under the follower's name. Raises as bringing up an
    arm does, TeleopError, and what ``person.confirm`` raises.
    """
    files = replace(follower.files, controllers=replace(follower.files.controllers, update_rate_hz=rate_hz))
    clock, worker, recording = MonotonicClock(), BackgroundWorker(), StackRecording(None)
    both = build_teleop(leader, replace(follower, files=files), clock, worker, recording.tap)
    stack, loop, signals = both.stack, both.loop, Signals(LEFT)
    run = LoopThread(stack, signals)
    with stack.configured(hangs=run.hangs):
        release_leader(both, person.confirm)  # until here a signal ends the program at once, and nothing has changed
        with signals, person:
            claim_realtime_priority()
            with recording.of(loop, files, wall_offset_s(clock, time.time), lambda: run.failed, stack.setup.scene):
                loop.activate(keep_inactive=[LEADER])
                _run(run, both, person)
    return 1 if run.failed or both.lost else 0


def _run(run: LoopThread, both: Teleop, person: Person) -> None:
    """The loop runs in its thread until this one says that it is enough."""
    attendance = Attendance(both, person, run.signals.ask)
    try:
        run_beside(run, lambda: attendance.look(time.monotonic()))
    finally:
        both.controller.allowed = False
