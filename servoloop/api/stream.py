"""Stream of targets from a program that computes them at its own rate, such as a learned policy."""

from collections.abc import Callable, Mapping

from servoloop.api.backend import ArmBackend
from servoloop.api.targets import Positions

Convert = Callable[[Positions], Mapping[str, float]]
"""Function that returns targets by joint."""


class TargetStream:
    """Open stream. Use the stream as a context manager, so that it is closed even after an error."""

    def __init__(self, backend: ArmBackend, convert: Convert, max_age_s: float) -> None:
        self._backend, self._convert = backend, convert
        backend.begin_stream(max_age_s)

    def send(self, targets: Positions) -> None:
        """Send the next targets. The next cycle moves toward them within the velocity and acceleration limits.

        Args:
            targets: Positions by joint name, or one position for each of ``Arm.joints``, in rad or m. Joints without a
                target hold their last target.

        Raises:
            ArmInputError: A joint is unknown, or a target is not finite or outside the limits. The last targets stay in
                effect.
            StreamEndedError: The stream was silent for longer than its limit, or is closed.
        """
        self._backend.send(self._convert(targets))

    def close(self) -> None:
        """End the stream. The joints slow down within their limits and hold. A second call has no effect."""
        self._backend.end_stream()

    def __enter__(self) -> "TargetStream":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
