"""ROS callbacks that wait for the loop without holding up the executor."""

from typing import TypeVar

from rclpy.task import Future

from controller.requests import Request

Result = TypeVar("Result")


class Waiting:
    """The requests under way. All in the ROS thread."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Request[object], Future]] = []

    async def result(self, request: "Request[Result]") -> Result:
        """What comes of it, once the loop has done it; raises what it raises. For ``async`` callbacks."""
        if not request.done:
            future: Future = Future()
            self._waiting.append((request, future))  # type: ignore[arg-type]
            await future
        return request.result()

    def settle(self) -> None:
        """After a cycle: those whose requests are done go on when the executor comes round."""
        done = [future for request, future in self._waiting if request.done]
        self._waiting = [pair for pair in self._waiting if not pair[0].done]
        for future in done:
            future.set_result(None)
