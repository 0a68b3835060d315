"""Frames from a camera, and the interface of all camera sources."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Picture: TypeAlias = NDArray[np.uint8]
"""An RGB image (height, width, 3), with the red channel first."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One image from a camera."""

    rgb: Picture
    """The image (height, width, 3), which must no longer be modified."""
    stamp_s: float
    """Capture time on the clock of the source, in seconds."""
    number: int
    """Sequence number of the frame since the source was opened. A gap in the numbers means that frames were lost."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, in pixels."""
        return self.rgb.shape[1], self.rgb.shape[0]


class CameraSource(Protocol):
    """A camera, a recording or a virtual camera. Only one thread may use a source."""

    @property
    def name(self) -> str:
        """Name of the source, for use in messages."""
        ...

    @property
    def rate_hz(self) -> float:
        """Measured rate of new frames, in Hz, or 0.0 before the second frame."""
        ...

    def open(self) -> None:
        """Open the source.

        Raises:
            CameraError: The source cannot be used. The message tells the user what to do.
        """
        ...

    def read(self, timeout_s: float) -> Frame:
        """Wait for a frame that is newer than the previous frame.

        Args:
            timeout_s: Maximum time to wait, in seconds.

        Returns:
            The latest frame.

        Raises:
            CameraSilent: No new frame arrived in time. The next call tries again.
            CameraError: The source can no longer be used.
        """
        ...

    def close(self) -> None:
        """Release the source. A closed source can be opened again."""
        ...
