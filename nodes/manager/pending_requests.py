"""Let ROS callbacks wait for the control loop without blocking the executor."""

from typing import TypeVar

from rclpy.task import Future

from controller.manager.requests import Request

Result = TypeVar("Result")


class PendingRequests:
    """Requests that the control loop has not completed yet. Only one thread at a time may call the methods of this
    class."""

    def __init__(self) -> None:
        self._pending: list[tuple[Request[object], Future]] = []

    async def result(self, request: "Request[Result]") -> Result:
        """Wait for the result of a request in an ``async`` callback. Exceptions raised by the request are passed to the
        caller."""
        if not request.done:
            future: Future = Future()
            self._pending.append((request, future))  # type: ignore[arg-type]
            await future
        return request.result()

    @property
    def any_done(self) -> bool:
        """Whether a request is complete but its callback has not been resumed yet."""
        return any(request.done for request, _ in self._pending)

    def resume_done(self) -> None:
        """Resume the callbacks of completed requests in the next iteration of the executor. Call this method after each
        cycle."""
        done = [future for request, future in self._pending if request.done]
        self._pending = [pair for pair in self._pending if not pair[0].done]
        for future in done:
            future.set_result(None)
