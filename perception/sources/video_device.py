"""Read a USB camera with OpenCV. A thread reads the frames, so that the caller always gets the latest frame."""

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, Protocol

import cv2
import numpy as np

from drivers.clock import Clock
from perception.frames import Frame, Picture
from perception.perception_errors import CameraError, CameraLost, CameraSilent
from perception.sources.devices import find_device
from perception.sources.rate import RateMeter

FROZEN_S: Final = 2.0
"""Time after which identical images indicate that the camera is frozen, in seconds. Real images differ because of
noise."""
STALE_S: Final = 1.0
"""Maximum age of a frame, in seconds. The driver may deliver frames that have been waiting in its queue."""
SAMPLE: Final = 8
"""Step between the pixels, in both directions, that are used to compare frames."""
JOIN_S: Final = 2.0
"""Maximum time to wait for the thread to end, in seconds."""


class Capture(Protocol):
    """Methods of cv2.VideoCapture that are used."""

    def isOpened(self) -> bool: ...
    def read(self) -> tuple[bool, Any]: ...
    def get(self, propId: int) -> float: ...
    def release(self) -> None: ...


def v4l2_capture(device: str, size: tuple[int, int], rate_hz: float) -> Capture:
    """Open a Video4Linux camera with an image size (width, height) and a frame rate."""
    capture = cv2.VideoCapture(device, cv2.CAP_V4L2)
    # Most cameras reach their full rate over USB 2 only with compressed images.
    capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    capture.set(cv2.CAP_PROP_FPS, rate_hz)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    return capture


class VideoDevice:
    """Camera source for a camera connected to this machine (see ``perception.frames.CameraSource``)."""

    def __init__(
        self,
        source: str,
        clock: Clock,
        size: tuple[int, int] = (640, 480),
        rate_hz: float = 30.0,
        capture: Callable[[str, tuple[int, int], float], Capture] = v4l2_capture,
        find: Callable[[str], str] = find_device,
    ) -> None:
        """Prepare the camera.

        Args:
            source: Path of the camera, preferably in /dev/v4l/by-id, or its index.
            clock: Monotonic clock for the timestamps.
            size: Width and height of the images, in pixels.
            rate_hz: Requested frame rate, in Hz.
            capture: Function that opens a device.
            find: Function that checks a source and returns the corresponding device.
        """
        self._source, self._clock, self._size, self._requested_hz = source, clock, size, rate_hz
        self._make_capture, self._find = capture, find
        self._capture: Capture | None = None
        self._thread: threading.Thread | None = None
        self._new = threading.Condition()
        self._stop = threading.Event()
        self._newest: Frame | None = None
        self._lost = False
        self._number = 0
        self._sample = b""
        self._changed_s = clock.now()
        self._rate = RateMeter()

    @property
    def name(self) -> str:
        """Name of the source for messages."""
        return f"/dev/video{self._source}" if self._source.isdecimal() else self._source

    @property
    def rate_hz(self) -> float:
        """Measured rate of new frames, in Hz; 0.0 before the second frame."""
        return self._rate.rate_hz

    def open(self) -> None:
        """Open the camera. Raises CameraError if the camera is missing, in use, or does not support the image size."""
        self.close()
        device = self._find(self._source)
        capture = self._make_capture(device, self._size, self._requested_hz)
        if not capture.isOpened():
            capture.release()
            raise CameraError(
                f"{self.name} cannot be opened as a camera: choose a camera that 'servoloop camera list' lists"
            )
        got = (int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        if got != self._size:
            capture.release()
            raise CameraError(
                f"{self.name} delivers {got[0]} × {got[1]} pixels instead of {self._size[0]} × {self._size[1]}: "
                "request a size that the camera supports"
            )
        self._reset()
        self._capture = capture
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._take, args=(capture, self._stop), name="camera", daemon=True)
        self._thread.start()

    def read(self, timeout_s: float) -> Frame:
        """Wait for a new frame.

        Raises:
            CameraSilent: No new frame arrived in time, or the images are frozen or outdated.
            CameraLost: The camera was unplugged or is not open.
        """
        with self._new:
            self._new.wait_for(lambda: self._newest is not None or self._lost or self._thread is None, timeout_s)
            if self._lost or self._thread is None:
                raise CameraLost(f"{self.name} delivers no more frames: check its plug")
            frame, self._newest = self._newest, None
            frozen_s = 0.0 if frame is None else frame.stamp_s - self._changed_s
        if frame is None:
            raise CameraSilent(
                f"{self.name} delivered no frame in {timeout_s:g} s: check its plug and the USB bandwidth"
            )
        if frozen_s > FROZEN_S:
            raise CameraSilent(
                f"{self.name} has delivered the same image for {frozen_s:.0f} s: unplug the camera, and plug it in "
                "again"
            )
        age_s = self._clock.now() - frame.stamp_s
        if age_s > STALE_S:
            raise CameraSilent(f"{self.name} delivers frames that are {age_s:.1f} s old: lower its rate or its size")
        return frame

    def close(self) -> None:
        """Release the camera."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(JOIN_S)
            self._thread = None
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def _reset(self) -> None:
        self._newest, self._lost, self._number, self._sample = None, False, 0, b""
        self._changed_s = self._clock.now()
        self._rate = RateMeter()

    def _take(self, capture: Capture, stop: threading.Event) -> None:
        """Read frames until the camera is closed or lost. A frame that OpenCV cannot decode counts as a loss, because
        the caller then opens the camera again."""
        try:
            with suppress(cv2.error):
                self._take_all(capture, stop)
        finally:
            with self._new:
                self._lost = self._lost or not stop.is_set()
                self._new.notify_all()

    def _take_all(self, capture: Capture, stop: threading.Event) -> None:
        while not stop.is_set():
            ok, bgr = capture.read()
            if stop.is_set() or not ok or bgr is None:
                return
            with self._new:
                self._accept(np.ascontiguousarray(bgr[..., ::-1]), self._stamp_s(capture))
                self._new.notify_all()

    def _accept(self, rgb: Picture, stamp_s: float) -> None:
        self._number += 1
        sample = rgb[::SAMPLE, ::SAMPLE].tobytes()
        if sample != self._sample:
            self._sample, self._changed_s = sample, stamp_s
        self._rate.add(stamp_s)
        self._newest = Frame(rgb, stamp_s, self._number)

    def _stamp_s(self, capture: Capture) -> float:
        """Return the capture time.

        Video4Linux reports this time on the monotonic clock, but some drivers do not report it.
        """
        now_s = self._clock.now()
        captured_s = 1e-3 * capture.get(cv2.CAP_PROP_POS_MSEC)
        return captured_s if 0.0 <= now_s - captured_s < 60.0 and captured_s > 0.0 else now_s
