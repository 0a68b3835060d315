"""Draw the grading results into an image."""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from perception.frames import Picture
from perception.grading.grader import GradedApple

GRADED: Final = (20, 200, 60)
NOT_GRADED: Final = (230, 140, 20)
FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
SCALE: Final = 0.45


def annotated(picture: Picture, apples: Sequence[GradedApple]) -> Picture:
    """Return a copy of an image in which each apple is marked with a box and its values."""
    drawn = picture.copy()
    for apple in apples:
        left, top, width, height = apple.box_px
        color = GRADED if apple.grade else NOT_GRADED
        cv2.rectangle(drawn, (left, top), (left + width, top + height), color, 2)
        values = f"{apple.diameter_mm:.0f} mm  red {apple.red_ratio:.2f}  defects {apple.defect_score:.2f}"
        _write(drawn, apple.grade or apple.reason, (left, top - 20))
        _write(drawn, values, (left, top - 5))
    return np.asarray(drawn, dtype=np.uint8)


def _write(picture: Picture, text: str, place: tuple[int, int]) -> None:
    """Draw text within the image that is legible on any background."""
    (width, height), _ = cv2.getTextSize(text, FONT, SCALE, 1)
    x = min(max(place[0], 2), max(picture.shape[1] - width - 2, 2))
    y = min(max(place[1], height + 2), picture.shape[0] - 4)
    for color, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.putText(picture, text, (x, y), FONT, SCALE, color, thickness, cv2.LINE_AA)
