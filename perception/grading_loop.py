"""Read frames from a camera and grade them in a loop. The camera is reopened after a failure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from drivers.clock import Clock
from perception.frames import CameraSource, Frame, Picture
from perception.grading.grader import GradedApple
from perception.perception_errors import CameraError, CameraSilent, PerceptionError, SourceEnded

RETRY_S: Final = 1.0
"""Time between two attempts to open a camera, in seconds."""
Grading = Callable[[Picture], Sequence[GradedApple]]
"""Function that grades an image, or raises a PerceptionError."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One frame and its apples."""

    frame: Frame
    apples: tuple[GradedApple, ...] | None
    """The apples in the image, or None if the image could not be graded."""


@dataclass(frozen=True, slots=True)
class GradingStatus:
    """State of the camera and of grading."""

    working: bool
    """Whether the last frame was graded."""
    message: str
    """One sentence that describes the state."""
    values: dict[str, str] = field(default_factory=dict)
    """Diagnostic values, keyed by name."""


class GradingLoop:
    """Loop that grades frames step by step. Only one thread may use it."""

    def __init__(self, source: CameraSource, grading: Grading, clock: Clock) -> None:
        self._source, self._grading, self._clock = source, grading, clock
        self._open = False
        self._retry_s = clock.now()
        self._next_number: int | None = None
        self._frames = self._lost = self._apples = self._attempts = 0
        self._grading_s = 0.0
        self._state = (False, f"{source.name} is not open yet")
        self.ended = False
        """Whether the source is a recording that has no more frames."""

    @property
    def status(self) -> GradingStatus:
        """State after the most recent step."""
        values = {
            "source": self._source.name,
            "rate_hz": f"{self._source.rate_hz if self._open else 0.0:.1f}",
            "frames": str(self._frames),
            "lost_frames": str(self._lost),
            "apples": str(self._apples),
            "grading_ms": f"{1000.0 * self._grading_s:.0f}",
            "reopened": str(max(self._attempts - 1, 0)),
        }
        return GradingStatus(*self._state, values)

    def step(self, timeout_s: float) -> Seen | None:
        """Read and grade the next frame.

        Args:
            timeout_s: Maximum time to wait, in seconds.

        Returns:
            The frame, or None if there is no frame. If there is no frame, ``status`` contains the reason.
        """
        if not self._open and not self._opened(timeout_s):
            return None
        try:
            frame = self._source.read(timeout_s)
        except CameraSilent as error:
            self._fail(str(error))
            return None
        except CameraError as error:
            self.ended = isinstance(error, SourceEnded)
            self._fail(str(error))
            self.close()
            return None
        self._count(frame)
        return Seen(frame, self._graded(frame))

    def close(self) -> None:
        """Release the camera. The next step reopens the camera."""
        if self._open:
            self._source.close()
        self._open = False
        self._retry_s = self._clock.now() + RETRY_S

    def _opened(self, timeout_s: float) -> bool:
        now_s = self._clock.now()
        if now_s < self._retry_s or self.ended:
            self._clock.sleep_until(min(self._retry_s if not self.ended else now_s + timeout_s, now_s + timeout_s))
            return False
        try:
            self._source.open()
        except PerceptionError as error:
            self._retry_s = self._clock.now() + RETRY_S
            self._fail(str(error))
            return False
        self._open, self._next_number = True, None
        self._attempts += 1
        return True

    def _graded(self, frame: Frame) -> tuple[GradedApple, ...] | None:
        start_s = self._clock.now()
        try:
            apples = tuple(self._grading(frame.rgb))
        except PerceptionError as error:
            self._fail(str(error))
            return None
        self._grading_s = self._clock.now() - start_s
        self._apples = len(apples)
        self._state = (True, f"{len(apples)} apples in the image")
        return apples

    def _count(self, frame: Frame) -> None:
        self._frames += 1
        if self._next_number is not None:
            self._lost += max(frame.number - self._next_number, 0)
        self._next_number = frame.number + 1

    def _fail(self, message: str) -> None:
        self._apples = 0
        self._state = (False, message)
