"""Clock of a command server that works between two cycles, in the thread of a simulated loop."""

from collections.abc import Callable

from controller.loop import ControlLoop
from servoloop.api.pace import Observers


class BetweenCycles:
    """Pace and clock of a command server in simulated time.

    Simulated time does not advance while the server works. Therefore, waiting immediately executes the pending requests
    to the loop.
    """

    def __init__(self, loop: ControlLoop) -> None:
        self._loop = loop
        self._observers = Observers()

    def now(self) -> float:
        """Return the time of the loop's clock, in seconds."""
        return self._loop.clock.now()

    def cycle_done(self) -> None:
        """Call the observers."""
        self._observers.call()

    def watch(self, observer: Callable[[], None]) -> Callable[[], None]:
        """Call a function after each cycle, and return a function that stops the calls."""
        return self._observers.add(observer)

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Execute the pending requests to the loop, and return whether the condition holds."""
        self._loop.requests.serve()
        return until()

    async def wait_async(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait as ``wait`` does."""
        return self.wait(until, timeout_s)

    def close(self) -> None:
        """Do nothing, because there is no thread to end."""
