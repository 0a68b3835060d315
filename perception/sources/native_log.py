"""Silence the log output of OpenCV and FFmpeg. The exceptions of this package report the same errors."""

import os
from typing import Final

import cv2

SILENT: Final = "-8"
"""FFmpeg log level that suppresses all messages."""


def silence_native_log() -> None:
    """Suppress messages from OpenCV and FFmpeg on stderr, for this process. Call this function before the first video
    is opened."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", SILENT)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
