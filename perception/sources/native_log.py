"""Silence the log of OpenCV and FFmpeg. The exceptions of this package describe the same errors."""

import os
from typing import Final

import cv2

SILENT: Final = "-8"
"""FFmpeg's log level without any message."""


def silence_native_log() -> None:
    """Stop messages of OpenCV and FFmpeg on stderr, for this process. Call this before the first video is opened."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", SILENT)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
