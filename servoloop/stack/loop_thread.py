"""The loop thread of ``servoloop up``: the only one that talks to the hardware."""

import gc
import logging
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from drivers.clock import Clock, MonotonicClock
from drivers.errors import DriverError
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.processes import put_first
from servoloop.stack.signals import Signals

LOG = logging.getLogger("servoloop")

HANG_S: Final = 30.0
"""The longest step on the way to the end has 10 s: waiting for what is being switched."""
LEFT: Final = "servos under torque hold their last goal"
LOOK_S: Final = 0.02
"""So often a person beside the loop is asked, and shown what happens."""


@dataclass(slots=True)
class LoopThread:
    """The loop thread runs the control loop, then brings the arm to its end, and says what became of both."""

    stack: ControlStack
    signals: Signals
    failed: bool = True
    """Until all has gone well."""
    done: bool = False
    wall: Clock = field(default_factory=MonotonicClock)
    """What a thread that hangs is noticed by: the loop's own clock may be simulated."""
    alive_s: float = 0.0
    """When the loop's thread was last seen to get on, or had no reason yet to end."""
    before_cycle: Callable[[Callable[[], bool]], None] = lambda ended: None
    """Holds the loop up between two cycles, at the most until what it is given is true."""

    def start(self) -> threading.Thread:
        """The loop runs in a thread of its own, which does not keep a program from ending in which it hangs."""
        self.alive_s = self.wall.now()
        thread = threading.Thread(target=self, name="control loop", daemon=True)
        thread.start()
        return thread

    def __call__(self) -> None:
        """The thread's work. The arm is brought to its end whatever ends the loop."""
        ran = False
        try:
            put_first()
            self.stack.loop.run(self._stop)
            ran = True
        except DriverError as error:
            LOG.error("the loop ends: %s", error)
        except Exception:  # a defect: whatever it is, the arm is still brought to its end below
            LOG.exception("the loop ends")
        finally:
            try:
                self.failed = bool(self.stack.end(lambda: self._told(2))) or not ran
            finally:
                self.done = True  # the other thread waits for it, whatever happened here

    def hangs(self) -> bool:
        """Whether the thread has been told to end and has got no further for so long: it waits for hardware for ever.

        Our own hardware waits for no reply for ever. A user's plug-in may.
        """
        now_s = self.wall.now()
        if not self.signals.count:
            self.alive_s = now_s
        return not self.done and now_s - self.alive_s > HANG_S

    def _stop(self) -> bool:
        self.before_cycle(lambda: self._told(1))
        return self._told(1)

    def _told(self, signals: int) -> bool:
        """The loop asks in every cycle, also on its way to the park pose."""
        self.alive_s = self.wall.now()
        return self.signals.count >= signals


def run_beside(run: LoopThread, look: Callable[[], None]) -> None:
    """The loop runs in its thread, and this one looks, until the loop has ended or hangs. It ends with this one too."""
    sys.setswitchinterval(0.0001)  # so long the loop waits at most for this thread to let go
    gc.collect()
    gc.freeze()
    thread = run.start()
    try:
        while not (run.done or run.hangs()):
            look()
            time.sleep(LOOK_S)
    finally:
        run.signals.ask()
        while thread.is_alive() and not run.hangs():
            thread.join(0.1)
        gc.unfreeze()
