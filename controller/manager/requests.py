"""Requests of other threads are served in the loop's thread, between two cycles."""

from collections import deque
from collections.abc import Callable
from threading import Lock
from typing import Any, Generic, TypeVar

Result = TypeVar("Result")

ENDED = "the control loop has ended"


class Request(Generic[Result]):
    """One request of another thread. The loop's thread fulfils it; any thread may look."""

    def __init__(self, action: Callable[[], Result]) -> None:
        self._action = action
        self.done = False
        self._result: Result | None = None
        self._error: Exception | None = None

    def serve(self) -> None:
        """Serve the request. ``done`` comes last, because other threads look at it."""
        try:
            self._result = self._action()
        except Exception as error:  # it belongs to the client
            self._error = error
        self.done = True

    def refuse(self, error: Exception) -> None:
        """The request will not be served."""
        self._error = error
        self.done = True

    def result(self) -> Result:
        """The result of the request; raises its error."""
        assert self.done
        if self._error is not None:
            raise self._error
        return self._result  # type: ignore[return-value]  # None only where Result allows it


class Requests:
    """The loop's inbox."""

    def __init__(self) -> None:
        self.inbox: deque[Request[Any]] = deque()
        """Whether there is anything to serve may be looked up without the lock."""
        self._lock = Lock()  # held for an append or a pop, never while something is done
        self._ended = False

    def ask(self, action: Callable[[], Result]) -> Request[Result]:
        """Have ``action`` done at the beginning of the next cycle. From any thread; never waits."""
        request = Request(action)
        with self._lock:
            if not self._ended:
                self.inbox.append(request)
                return request
        request.refuse(RuntimeError(ENDED))
        return request

    def serve(self) -> None:
        """Serve all requests. In the loop's thread."""
        while request := self._next():
            request.serve()

    def end(self) -> None:
        """Refuse requests that still wait. In the loop's thread, after its last cycle."""
        with self._lock:
            self._ended = True
        while request := self._next():
            request.refuse(RuntimeError(ENDED))

    def _next(self) -> Request[Any] | None:
        with self._lock:
            return self.inbox.popleft() if self.inbox else None
