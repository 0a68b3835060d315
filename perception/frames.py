"""Frames of a camera, and the interface of all camera sources."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Picture: TypeAlias = NDArray[np.uint8]
"""An RGB image (height, width, 3); red comes first."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One image of a camera."""

    rgb: Picture
    """The image (height, width, 3), which its owner must no longer change."""
    stamp_s: float
    """Time of capture, in seconds on the clock of the source."""
    number: int
    """Sequence number of the frame since the source was opened. A gap means that frames were lost."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, in pixels."""
        return self.rgb.shape[1], self.rgb.shape[0]


class CameraSource(Protocol):
    """A camera, a recording or a virtual camera. Only one thread may use it."""

    @property
    def name(self) -> str:
        """Name of the source for messages."""
        ...

    @property
    def rate_hz(self) -> float:
        """Measured rate of new frames, in Hz; 0.0 before the second frame."""
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
            CameraError: The source cannot be used any more.
        """
        ...

    def close(self) -> None:
        """Release the source. A closed source can be opened again."""
        ...
