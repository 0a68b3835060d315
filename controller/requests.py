"""What other threads want done in the loop's thread, between two cycles."""

from collections import deque
from collections.abc import Callable
from threading import Lock
from typing import Any, Generic, TypeVar

Result = TypeVar("Result")

ENDED = "the control loop has ended"


class Request(Generic[Result]):
    """One wish. The loop's thread fulfils it; any thread may look."""

    def __init__(self, action: Callable[[], Result]) -> None:
        self._action = action
        self.done = False
        self._result: Result | None = None
        self._error: Exception | None = None

    def serve(self) -> None:
        """Do it. ``done`` comes last, because other threads look at it."""
        try:
            self._result = self._action()
        except Exception as error:  # it belongs to whoever asked
            self._error = error
        self.done = True

    def refuse(self, error: Exception) -> None:
        """It will not be done."""
        self._error = error
        self.done = True

    def result(self) -> Result:
        """What came of it; raises what it raised."""
        assert self.done
        if self._error is not None:
            raise self._error
        return self._result  # type: ignore[return-value]  # None only where Result allows it


class Requests:
    """The loop's inbox."""

    def __init__(self) -> None:
        self._inbox: deque[Request[Any]] = deque()
        self._lock = Lock()  # held for an append or a pop, never while something is done
        self._ended = False

    def ask(self, action: Callable[[], Result]) -> Request[Result]:
        """Have it done at the beginning of the next cycle. From any thread; never waits."""
        request = Request(action)
        with self._lock:
            if not self._ended:
                self._inbox.append(request)
                return request
        request.refuse(RuntimeError(ENDED))
        return request

    def serve(self) -> None:
        """In the loop's thread: do all that has been asked for."""
        while request := self._next():
            request.serve()

    def end(self) -> None:
        """In the loop's thread, after its last cycle: whoever still waits is told."""
        with self._lock:
            self._ended = True
        while request := self._next():
            request.refuse(RuntimeError(ENDED))

    def _next(self) -> Request[Any] | None:
        with self._lock:
            return self._inbox.popleft() if self._inbox else None
