"""Control loop that a script runs in a separate thread, with real servos or with virtual servos in a child process."""

import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Final

from drivers.clock import MonotonicClock, wall_offset_s
from hal.lifecycle import LifecycleState
from servoloop.api.arm_errors import ArmEndedError, ArmError
from servoloop.api.options import setup_errors
from servoloop.api.own_loop import CLOSED, OwnLoop, describe, ended_by
from servoloop.api.pace import ThreadPace
from servoloop.api.stack_backend import StackBackend
from servoloop.recording.stack_recording import StackRecording
from servoloop.stack import hardware
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.devices import parse_ports
from servoloop.stack.emulator_process import chosen_devices
from servoloop.stack.loop_thread import LEFT, POLL_S, LoopThread
from servoloop.stack.processes import PRIORITY, prompt_interpreter, realtime_priority
from servoloop.stack.robot_files import Files
from servoloop.stack.signals import Signals

END_SIGNALS: Final = (signal.SIGTERM, signal.SIGHUP)


class ThreadLoop(OwnLoop):
    """Control loop in its own thread, with real servos or with virtual servos in a child process."""

    def __init__(self, files: Files, ports: Sequence[str], record: Path | None) -> None:
        """Start the loop. Raises ArmSetupError.

        Args:
            files: Files of the arm.
            ports: Serial ports as for ``servoloop up``, or empty for virtual servos.
            record: Path of a new recording, if any.
        """
        super().__init__(files)
        self._signals = Signals()
        self._started = False
        """Whether the loop thread may use the ports, or must be started to shut the arm down."""
        recording = StackRecording(record)
        try:
            with setup_errors():
                self._start(ports, recording)
        except BaseException:
            if self._started:
                self.close()
            else:
                self._exit.close()
            raise

    def _start(self, ports: Sequence[str], recording: StackRecording) -> None:
        files, clock = self._files, MonotonicClock()
        given = parse_ports(ports, files.robot.file.lines())
        devices = self._exit.enter_context(chosen_devices(None, given, files))
        setup = hardware.build(None, files, devices, clock, tap=recording.tap)
        stack = self._build(setup, clock, BackgroundWorker())
        self._run = run = LoopThread(stack, self._signals)
        self._exit.enter_context(stack.configured(self._initial.unconfigured, hangs=run.hangs))
        pace = ThreadPace(clock, self.ended)
        self.backend = StackBackend(stack, describe(stack), pace, self.ended, recording)
        offset_s = wall_offset_s(clock, time.time)
        self._exit.enter_context(exit_on_signals())
        try:
            self._activate(stack, recording.of(stack.loop, files, offset_s, lambda: run.failed, setup.scene))
            self._exit.enter_context(prompt_interpreter(full_collections=True))
            # Only the loop thread gets this priority, because the program may compute for a long time.
            with realtime_priority(PRIORITY):
                self._started = True  # This line comes first, because Ctrl-C may interrupt the start.
                run.start()
        finally:
            self._started |= stack.loop.hardware.state is LifecycleState.ACTIVE
        self.backend.state()

    def ended(self) -> ArmEndedError | None:
        if not self._why_ended and self._run.done:
            self._why_ended = ended_by(self._run.error)
        return super().ended()

    def close(self) -> None:
        if self._closed or not self._started:
            return
        self._signals.ask()  # This call comes first, because a signal may interrupt each of the other calls.
        if not self._run.begun:
            self._run.start()
        self.ended()
        self._wait_for_shutdown()
        self._why_ended = self._why_ended or CLOSED
        self._exit.close()
        self._closed = True
        if not self._run.done:
            raise ArmError(f"the control loop is blocked by its hardware and could not be stopped: {LEFT}")
        if self._run.failed:
            raise ArmError(f"the arm was not shut down completely: {self._run.error or 'see the log'}")

    def _wait_for_shutdown(self) -> None:
        """Wait until the shutdown has finished or is stuck.

        Ctrl-C skips the park pose, like a second Ctrl-C in ``servoloop up``. The wait does not use ``Thread.join``: if
        Ctrl-C interrupts it, Python 3.11 and 3.12 report a running thread as ended.
        """
        while True:
            try:
                self.backend.close()
                while not (self._run.done or self._run.hangs()):
                    time.sleep(POLL_S)
                return
            except (KeyboardInterrupt, SystemExit):
                self._signals.count = 2


@contextmanager
def exit_on_signals() -> Iterator[None]:
    """Raise SystemExit in the main thread on SIGTERM and SIGHUP, so that ``with Arm(...)`` shuts the arm down.

    Signals that the program already handles or ignores are not affected. Outside the main thread, this context has no
    effect.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    taken = [number for number in END_SIGNALS if signal.getsignal(number) is signal.SIG_DFL]

    def end(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    for number in taken:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in taken:
            if signal.getsignal(number) is end:
                signal.signal(number, signal.SIG_DFL)
