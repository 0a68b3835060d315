"""Decode the output of a detector in the YOLOv8 layout."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray
from perception.frames import Picture

GRAY: Final = 114
"""Gray value of the margins that pad an image to the detector's input size."""
MOST_BOXES: Final = 300
"""Number of highest-scoring boxes that are compared with each other."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """One object in an image."""

    box_px: FloatArray
    """Left, top, right and bottom edges (4,), in image pixels."""
    label: int
    """Class index."""
    score: float


def fitted(picture: Picture, size: tuple[int, int]) -> tuple[NDArray[np.float32], float, FloatArray]:
    """Scale and pad an image to the detector's input size.

    Args:
        picture: RGB image (height, width, 3).
        size: Width and height of the input.

    Returns:
        The input (1, 3, height, width) with values from 0 to 1, the scale, and the left and top margins (2,).
    """
    height, width = picture.shape[:2]
    scale = min(size[0] / width, size[1] / height)
    scaled = cv2.resize(picture, (max(1, round(width * scale)), max(1, round(height * scale))))
    left, top = (size[0] - scaled.shape[1]) // 2, (size[1] - scaled.shape[0]) // 2
    canvas = np.full((size[1], size[0], 3), GRAY, np.uint8)
    canvas[top : top + scaled.shape[0], left : left + scaled.shape[1]] = scaled
    values = canvas.transpose(2, 0, 1)[np.newaxis].astype(np.float32) / 255.0
    return np.ascontiguousarray(values), scale, np.array([left, top], dtype=np.float64)


def decoded(output: NDArray[np.float32], least_score: float, most_overlap: float) -> list[Detection]:
    """Return the objects in an output (4 + classes, boxes), in input pixels, sorted by descending score.

    Args:
        output: Center x, center y, width, height and the score of each class, for each box.
        least_score: Minimum score of a box.
        most_overlap: Maximum intersection over union at which two boxes are considered separate objects.
    """
    scores = output[4:]
    labels = scores.argmax(axis=0)
    best = scores[labels, np.arange(scores.shape[1])]
    usable = (best >= least_score) & np.isfinite(output).all(axis=0) & (output[2] > 0.0) & (output[3] > 0.0)
    order = np.flatnonzero(usable)
    order = order[np.argsort(-best[order], kind="stable")][:MOST_BOXES]
    centers, halves = output[:2, order].T.astype(np.float64), 0.5 * output[2:4, order].T.astype(np.float64)
    boxes = np.hstack([centers - halves, centers + halves])
    kept = _separate(boxes, most_overlap)
    return [Detection(boxes[i], int(labels[order[i]]), float(best[order[i]])) for i in kept]


def _separate(boxes: FloatArray, most_overlap: float) -> list[int]:
    """Return the indices of boxes (n, 4), sorted by descending score, that do not overlap with a better box."""
    kept: list[int] = []
    for index in range(len(boxes)):
        if not kept or float(_overlaps(boxes[index], boxes[kept]).max()) <= most_overlap:
            kept.append(index)
    return kept


def _overlaps(box: FloatArray, others: FloatArray) -> FloatArray:
    """Return the intersection over union of one box (4,) with each of several boxes (n, 4)."""
    low, high = np.maximum(box[:2], others[:, :2]), np.minimum(box[2:], others[:, 2:])
    shared = np.prod(np.maximum(high - low, 0.0), axis=1)
    areas = np.prod(others[:, 2:] - others[:, :2], axis=1)
    overlaps: FloatArray = shared / (float(np.prod(box[2:] - box[:2])) + areas - shared)
    return overlaps
