"""Errors of cameras, calibration and grading.

PerceptionError
├── CameraError          the camera cannot be used
│   ├── CameraMissing    the camera does not exist
│   ├── CameraBusy       another program uses the camera
│   ├── CameraDenied     the user has no permission to open the camera
│   ├── CameraLost       the camera disappeared while it was open
│   ├── CameraSilent     no new frame arrived in time
│   └── SourceEnded      a recording has no more frames
├── CalibrationRefused   the views do not determine the calibration
├── PictureRefused       the image cannot be graded
├── CameraFileError      errors in a calibration file
├── GradesFileError      errors in a file of thresholds or classes
└── DetectorError        the file of the detector cannot be used
"""

from pathlib import Path

from hal.hal_errors import HalError


class PerceptionError(HalError):
    """Base class of all errors of this package. The message tells the user what to do."""


class CameraError(PerceptionError):
    """The camera cannot be used."""


class CameraMissing(CameraError):
    """The camera does not exist."""


class CameraBusy(CameraError):
    """Another program uses the camera."""


class CameraDenied(CameraError):
    """The user has no permission to open the camera."""


class CameraLost(CameraError):
    """The camera disappeared while it was open."""


class CameraSilent(CameraError):
    """No new frame arrived in time, the frames do not change, or the next image of a folder is damaged."""


class SourceEnded(CameraError):
    """A recording has no more frames."""


class CalibrationRefused(PerceptionError):
    """The views do not determine the calibration."""


class PictureRefused(PerceptionError):
    """The image cannot be graded."""


class CameraFileError(PerceptionError):
    """A calibration file has errors. The message lists all of them."""


class GradesFileError(PerceptionError):
    """A file that contains thresholds or classes has errors. The message lists all of them."""


class DetectorError(PerceptionError):
    """The detector file cannot be used."""


def unreadable(path: Path, error: OSError) -> str:
    """Return the message about a file or folder that cannot be read."""
    return f"cannot read {path}: {error.strerror}: check the path and its permissions"
