"""Choose a camera source from its name on the command line."""

from pathlib import Path

from drivers.clock import Clock
from perception.frames import CameraSource
from perception.perception_errors import CameraMissing
from perception.sources.recorded import RecordedSource
from perception.sources.video_device import VideoDevice


def source_of(text: str, clock: Clock, size: tuple[int, int], rate_hz: float) -> CameraSource:
    """Return the source that a string specifies, without opening the source.

    Args:
        text: An index, a device path, or the path of a video, an image or a folder of images.
        clock: Clock for the timestamps.
        size: Width and height to request from a camera, in pixels.
        rate_hz: Frame rate to request from a camera, in Hz.

    Raises:
        CameraMissing: The string is empty.
    """
    if not text.strip():
        raise CameraMissing(
            "no camera is specified: choose one that 'servoloop camera list' lists, a video or a folder"
        )
    if text.isdecimal() or text.startswith("/dev/"):
        return VideoDevice(text, clock, size, rate_hz)
    return RecordedSource(Path(text), clock)
