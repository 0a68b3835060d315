"""Serve requests from other threads in the loop thread, between two cycles."""

from collections import deque
from collections.abc import Callable
from threading import Lock
from typing import Any, Generic, TypeVar

Result = TypeVar("Result")

ENDED = "the control loop has ended"


class Request(Generic[Result]):
    """A request from another thread. The loop thread serves the request, and any thread may read its state."""

    def __init__(self, action: Callable[[], Result]) -> None:
        self._action = action
        self.done = False
        self._result: Result | None = None
        self._error: Exception | None = None

    def serve(self) -> None:
        """Serve the request. Other threads poll ``done``, so it is set after all other fields."""
        try:
            self._result = self._action()
        except Exception as error:  # ``result`` raises the error in the client's thread.
            self._error = error
        self.done = True

    def refuse(self, error: Exception) -> None:
        """Complete the request with an error, without serving it."""
        self._error = error
        self.done = True

    def result(self) -> Result:
        """Return the result of the request, or raise its error."""
        assert self.done
        if self._error is not None:
            raise self._error
        return self._result  # type: ignore[return-value]  # It is None only if Result allows None.


class LoopRequests:
    """Queue of requests that are waiting for the loop."""

    def __init__(self) -> None:
        self.inbox: deque[Request[Any]] = deque()
        """Waiting requests. The loop may check whether the queue is empty without holding the lock."""
        self._lock = (
            Lock()
        )  # The lock is held only while a request is added or removed, never while a request is served.
        self._ended = False

    def ask(self, action: Callable[[], Result]) -> Request[Result]:
        """Request that the loop call ``action`` at the start of the next cycle.

        Any thread may call this method. The call never waits.
        """
        request = Request(action)
        with self._lock:
            if not self._ended:
                self.inbox.append(request)
                return request
        request.refuse(RuntimeError(ENDED))
        return request

    def serve(self) -> None:
        """Serve all pending requests. Call this method in the loop thread."""
        while request := self._next():
            request.serve()

    def end(self) -> None:
        """Reject all pending and future requests. Call this method in the loop thread, after its last cycle."""
        with self._lock:
            self._ended = True
        while request := self._next():
            request.refuse(RuntimeError(ENDED))

    def _next(self) -> Request[Any] | None:
        with self._lock:
            return self.inbox.popleft() if self.inbox else None
