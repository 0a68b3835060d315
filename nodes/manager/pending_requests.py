"""Requests to the loop for which ROS callbacks wait without holding up the executor."""

from typing import TypeVar

from rclpy.task import Future

from controller.manager.requests import Request

Result = TypeVar("Result")


class PendingRequests:
    """The requests that the loop has not done yet. All in the ROS thread."""

    def __init__(self) -> None:
        self._pending: list[tuple[Request[object], Future]] = []

    async def result(self, request: "Request[Result]") -> Result:
        """The request's result, once the loop has done it; raises what the request raises. For ``async`` callbacks."""
        if not request.done:
            future: Future = Future()
            self._pending.append((request, future))  # type: ignore[arg-type]
            await future
        return request.result()

    def resume_done(self) -> None:
        """After a cycle: callbacks whose requests are done go on when the executor comes round."""
        done = [future for request, future in self._pending if request.done]
        self._pending = [pair for pair in self._pending if not pair[0].done]
        for future in done:
            future.set_result(None)
