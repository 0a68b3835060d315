"""Handles for the motions and streams that a program has started."""

import math
from collections.abc import Callable, Generator, Mapping
from typing import Any

from servoloop.api.arm_errors import ArmTimeoutError
from servoloop.api.backend import ArmBackend, MotionProgress
from servoloop.api.checks import checked_timeout
from servoloop.api.targets import Positions

Convert = Callable[[Positions], Mapping[str, float]]
"""Function that converts a program's targets to targets keyed by joint name."""


class ArmMotion:
    """Running motion. Wait for the motion with ``wait``, await it in a coroutine, or cancel it."""

    def __init__(self, backend: ArmBackend, progress: MotionProgress) -> None:
        self._backend, self._progress = backend, progress

    @property
    def done(self) -> bool:
        """Whether the motion has ended, with or without success."""
        return self._progress.done

    @property
    def failure(self) -> Exception | None:
        """Error of a motion that failed or was canceled. None while the motion is running and after success."""
        return self._progress.failure

    def wait(self, timeout_s: float = math.inf) -> None:
        """Wait until the motion has reached its target.

        Args:
            timeout_s: Maximum time to wait, in seconds on the arm's clock.

        Raises:
            MotionFailedError: The motion stopped before it reached its target.
            MotionCanceledError: The motion was canceled or replaced by another motion.
            ArmTimeoutError: The motion takes longer than ``timeout_s``. The arm keeps moving.
            ArmEndedError: The control loop has ended.
        """
        limit_s = checked_timeout(timeout_s)
        self._finish(self._backend.wait(lambda: self.done, limit_s), limit_s)

    async def wait_async(self, timeout_s: float = math.inf) -> None:
        """Wait as ``wait`` does, without blocking the event loop. Canceling the task also cancels the motion."""
        try:
            reached = await self._backend.wait_async(lambda: self.done, timeout_s)
        except BaseException:
            self.cancel()
            raise
        self._finish(reached, timeout_s)

    def __await__(self) -> Generator[Any, None, None]:
        return self.wait_async().__await__()

    def cancel(self) -> None:
        """Cancel the motion. A second call has no effect.

        The joints slow down within their limits and hold their positions.
        """
        if not self.done:
            self._backend.cancel(self._progress)

    def _finish(self, ended: bool, timeout_s: float) -> None:
        if not ended:
            raise ArmTimeoutError(
                f"the motion did not end within {timeout_s:g} s and is still running: wait for its end or cancel it"
            )
        if (failure := self.failure) is not None:
            raise failure


class TargetStream:
    """Open stream for targets from a program that computes them at its own rate, such as a learned policy.

    Use the stream as a context manager, so that it is closed even after an error.
    """

    def __init__(self, backend: ArmBackend, convert: Convert, max_age_s: float) -> None:
        self._backend, self._convert = backend, convert
        backend.begin_stream(max_age_s)

    def send(self, targets: Positions) -> None:
        """Send the next targets. The joints move toward the targets within their velocity and acceleration limits.

        Args:
            targets: Positions keyed by joint name, or one position for each of ``Arm.joints``, in rad or m. Joints
                without a target hold their positions at their last targets.

        Raises:
            ArmInputError: A joint is unknown, or a target is not finite or outside the limits. The last targets stay in
                effect.
            StreamEndedError: No target arrived within the stream's time limit, or the stream is closed.
        """
        self._backend.send(self._convert(targets))

    def close(self) -> None:
        """End the stream. A second call has no effect.

        The joints slow down within their limits and hold their positions.
        """
        self._backend.end_stream()

    def __enter__(self) -> "TargetStream":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
