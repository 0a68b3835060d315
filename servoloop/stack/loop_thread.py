"""Run the control loop in its own thread, the only thread that accesses the hardware."""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from drivers.clock import Clock, MonotonicClock
from drivers.driver_errors import DriverError
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.processes import prompt_interpreter, put_first
from servoloop.stack.signals import Signals

LOG = logging.getLogger("servoloop")

HANG_S: Final = 30.0
"""Time without progress after which the loop thread is considered hanging, in seconds.

The longest step of a shutdown is waiting for a hardware or controller change, which may take 10 s.
"""
LEFT: Final = "servos with torque enabled hold their last goal"
POLL_S: Final = 0.02
"""Period at which a waiting thread checks whether the loop thread has ended, in seconds."""


@dataclass(slots=True)
class LoopThread:
    """Thread that runs the control loop and then shuts the arm down."""

    stack: ControlStack
    signals: Signals
    failed: bool = True
    """Whether the loop or the shutdown failed. True until both have succeeded."""
    done: bool = False
    """Whether the loop and the shutdown have ended."""
    error: Exception | None = None
    """Error that ended the loop, if any."""
    wall: Clock = field(default_factory=MonotonicClock)
    """Clock for detecting a hanging thread, because the clock of the loop may be simulated."""
    alive_s: float = 0.0
    """Time at which the loop thread last made progress, in seconds.

    Before the first signal, this is the time of the last check.
    """
    before_cycle: Callable[[Callable[[], bool]], None] = lambda ended: None
    """Function called before each cycle. It may delay the loop until the function passed to it returns true."""
    _owned: threading.Lock = field(default_factory=threading.Lock)
    """Lock that the thread of the loop takes when it begins, and keeps."""

    @property
    def begun(self) -> bool:
        """Whether the thread has begun to run the loop."""
        return self._owned.locked()

    def start(self) -> threading.Thread:
        """Start the loop in a daemon thread. The program can end even if this thread hangs.

        A call that Ctrl-C has interrupted can be repeated: only the first thread that begins runs the loop.
        """
        self.alive_s = self.wall.now()
        thread = threading.Thread(target=self, name="control loop", daemon=True)
        thread.start()
        return thread

    def __call__(self) -> None:
        """Run the loop, then shut the arm down, even after an error in the loop."""
        if not self._owned.acquire(blocking=False):
            return
        ran = False
        try:
            put_first()
            self.stack.loop.run(self._stop)
            ran = True
        except DriverError as error:
            self.error = error
            LOG.error("the control loop has stopped: %s", error)
        except Exception as error:  # the arm must be shut down after any error
            self.error = error
            LOG.exception("the control loop has stopped after an internal error")
        finally:
            try:
                self.failed = bool(self.stack.end(lambda: self._signaled(2))) or not ran
            finally:
                self.done = True  # the other thread waits for this flag, even after an error

    def hangs(self) -> bool:
        """Return whether the thread has made no progress for ``HANG_S`` after a shutdown request.

        All reads of servoloop's own hardware time out. A user's plugin may wait forever.
        """
        now_s = self.wall.now()
        if not self.signals.count:
            self.alive_s = now_s
        return not self.done and now_s - self.alive_s > HANG_S

    def _stop(self) -> bool:
        self.before_cycle(lambda: self._signaled(1))
        return self._signaled(1)

    def _signaled(self, signals: int) -> bool:
        """Return whether at least this number of signals has arrived.

        The loop calls this method in every cycle, even while parking.
        """
        self.alive_s = self.wall.now()
        return self.signals.count >= signals


def run_beside(run: LoopThread, poll: Callable[[], None]) -> None:
    """Run the loop in its thread and call ``poll`` in this thread until the loop has ended or hangs.

    An error in ``poll`` also ends the loop.
    """
    with prompt_interpreter():
        thread = run.start()
        try:
            while not (run.done or run.hangs()):
                poll()
                time.sleep(POLL_S)
        finally:
            run.signals.ask()
            while thread.is_alive() and not run.hangs():
                thread.join(0.1)
