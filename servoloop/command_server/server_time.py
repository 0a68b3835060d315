"""Time of a command server. A server uses real time, except in simulations."""

import time
from collections.abc import Callable
from typing import Final, Protocol

POLL_S: Final = 0.005
"""Period at which a condition is checked, in seconds."""


class ServerTime(Protocol):
    """Clock of a command server, with a way to wait for the control loop."""

    def now(self) -> float:
        """Return the current time in seconds, on the clock used for ``sent_s`` in each message."""
        ...

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until a condition holds, for at most ``timeout_s`` seconds, and return whether it holds."""
        ...


class RealTime:
    """The machine's CLOCK_MONOTONIC, which all its clients share."""

    now = staticmethod(time.monotonic)

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        deadline_s = self.now() + timeout_s
        while not until():
            if self.now() > deadline_s:
                return False
            time.sleep(POLL_S)
        return True
