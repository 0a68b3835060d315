"""Play a recorded video or a folder of images as a camera source at its own rate."""

import os
from collections.abc import Iterator
from contextlib import suppress
from errno import EACCES
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from drivers.clock import Clock
from perception.frames import Frame, Picture
from perception.perception_errors import CameraError, CameraMissing, CameraSilent, SourceEnded, unreadable
from perception.sources.rate import RateMeter

PICTURES: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
FOLDER_HZ: Final = 10.0
"""Rate at which the images of a folder are played, in Hz."""
RATES_HZ: Final = (0.1, 240.0)
"""Range of plausible video frame rates, in Hz."""


class RecordedSource:
    """Camera source for a file or a folder (see ``perception.frames.CameraSource``)."""

    def __init__(self, path: Path, clock: Clock) -> None:
        """Prepare the source.

        Args:
            path: A video, an image, or a folder of images, which are played in name order.
            clock: Clock for the timestamps.
        """
        self._path, self._clock = path, clock
        self._pictures: Iterator[Picture] = iter(())
        self._interval_s = 1.0 / FOLDER_HZ
        self._due_s = 0.0
        self._number = 0
        self._rate = RateMeter()

    @property
    def name(self) -> str:
        """Name of the source for messages."""
        return str(self._path)

    @property
    def rate_hz(self) -> float:
        """Measured rate of new frames, in Hz; 0.0 before the second frame."""
        return self._rate.rate_hz

    def open(self) -> None:
        """Start with the first image. Raises CameraError if there are no images."""
        self._interval_s = 1.0 / FOLDER_HZ
        try:
            self._pictures = self._opened()
        except OSError as error:
            raise CameraError(unreadable(self._path, error)) from error
        self._number, self._rate = 0, RateMeter()
        self._due_s = self._clock.now()

    def read(self, timeout_s: float) -> Frame:
        """Wait until the next image is due, and return it.

        Raises:
            CameraSilent: The next image is not due within the timeout, or cannot be read. In both cases, the next call
                continues.
            SourceEnded: There are no more images.
        """
        now_s = self._clock.now()
        if self._due_s > now_s + timeout_s:
            self._clock.sleep_until(now_s + timeout_s)
            raise CameraSilent(f"the next image of {self._path} is not due within {timeout_s:g} s: wait longer")
        self._clock.sleep_until(self._due_s)
        try:
            rgb = next(self._pictures, None)
        except CameraError as error:  # If the source were opened again, it would repeat the images before this one.
            self._count()
            raise CameraSilent(str(error)) from error
        if rgb is None:
            raise SourceEnded(
                f"{self._path} has no more images after image {self._number}: start again to repeat the recording"
            )
        stamp_s = self._count()
        self._rate.add(stamp_s)
        return Frame(rgb, stamp_s, self._number)

    def close(self) -> None:
        """Release the file."""
        self._pictures = iter(())

    def _count(self) -> float:
        """Count an image, schedule the next one, and return the current time in seconds."""
        now_s = self._clock.now()
        self._due_s = max(self._due_s + self._interval_s, now_s)
        self._number += 1
        return now_s

    def _opened(self) -> Iterator[Picture]:
        """Return the images. Raises CameraError or OSError."""
        if not self._path.exists():
            raise CameraMissing(f"there is no file or folder {self._path}: specify a video or a folder of images")
        if self._path.is_dir():
            files = sorted(file for file in self._path.iterdir() if file.suffix.lower() in PICTURES)
            if not files:
                raise CameraMissing(
                    f"the folder {self._path} has no images ({', '.join(PICTURES)}): choose another folder"
                )
            return map(read_picture, files)
        if self._path.suffix.lower() in PICTURES:
            return iter((read_picture(self._path),))
        return self._video()

    def _video(self) -> Iterator[Picture]:
        if not os.access(self._path, os.R_OK):
            raise PermissionError(EACCES, os.strerror(EACCES))
        capture = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            capture.release()
            raise CameraError(
                f"{self._path} is not a video that OpenCV can read: convert it to MP4, or specify an image"
            )
        rate_hz = float(capture.get(cv2.CAP_PROP_FPS))
        if RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
            self._interval_s = 1.0 / rate_hz
        return _frames_of(capture)


def read_picture(path: Path) -> Picture:
    """Read a file as an RGB image (height, width, 3). Raises CameraError if the file is not an image."""
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
        bgr = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    except OSError as error:
        raise CameraError(unreadable(path, error)) from error
    except cv2.error:
        bgr = None
    if bgr is None:
        raise CameraError(f"{path} is not an image, or is damaged: remove the file")
    return np.ascontiguousarray(bgr[..., ::-1]).astype(np.uint8, copy=False)


def _frames_of(capture: cv2.VideoCapture) -> Iterator[Picture]:
    try:
        while True:
            ok, bgr = False, None
            with suppress(cv2.error):  # A frame that OpenCV cannot decode ends the video.
                ok, bgr = capture.read()
            if not ok or bgr is None:
                return
            yield np.ascontiguousarray(bgr[..., ::-1]).astype(np.uint8, copy=False)
    finally:
        capture.release()
