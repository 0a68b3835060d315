"""Find the outlines of apples in a mask of colored pixels, and split the mask between touching apples."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray
from perception.grading.light import Pixels

FloatMap = NDArray[np.float32]
Mask = NDArray[np.uint8]
"""Image (height, width) with the value 255 at pixels that belong to the mask, and 0 elsewhere."""

LEAST_SATURATION: Final = 0.3
"""Minimum saturation of a colored pixel: 1 - min / max, relative to the table. Shadows on the table have a saturation
of 0."""
SMALLEST_PX: Final = 60
"""Minimum area of an apple, in pixels."""
NECK: Final = 0.86
"""Maximum width of a mask's neck between two apples, as a fraction of the smaller apple."""
LEAST_PART: Final = 0.35
"""Minimum half width at which a part of a mask is considered an apple, as a fraction of the largest part."""
LEAST_REST: Final = 0.06
"""Minimum visible area of an apple behind another apple, as a fraction of the other apple's area."""
BOX_POINTS: Final = 72
"""Number of points in an outline that is created from a box."""
BORDER_PX: Final = 2
"""Distance from the image edge below which an outline is considered cut off, in pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Visible outline of one apple."""

    pixels: FloatArray
    """Pixels (n, 2) of the outline, except for pixels next to another apple or at the image edge."""
    mask: Mask
    """Mask of the apple's colored pixels (height, width of ``box``)."""
    box: tuple[int, int, int, int]
    """Left, top, width and height of ``mask`` in the image, in pixels."""
    cut: bool
    """Whether the apple is cut off by the image edge."""


def colored(relative: Pixels, region: NDArray[np.bool_] | None = None) -> Mask:
    """Return the mask of pixels whose color differs from the table color.

    Args:
        relative: Linear RGB (height, width, 3), relative to the table.
        region: Mask (height, width) of the pixels in which to search for apples, or None for all pixels.
    """
    red, green, blue = cv2.split(relative)  # in NumPy, a minimum over three values takes far longer
    largest, smallest = cv2.max(cv2.max(red, green), blue), cv2.min(cv2.min(red, green), blue)
    mask = np.where(largest - smallest > LEAST_SATURATION * largest, 255, 0).astype(np.uint8)
    if region is not None:
        mask[~region] = 0
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, disk)
    return _filled(cv2.morphologyEx(opened, cv2.MORPH_CLOSE, disk))


def _filled(mask: NDArray[np.generic]) -> Mask:
    """Fill the holes in a mask, which are gray spots and reflections."""
    contours = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    filled = np.zeros(mask.shape, np.uint8)
    cv2.drawContours(filled, list(contours), -1, 255, cv2.FILLED)
    return filled


def outlines(mask: Mask) -> list[Outline]:
    """Return the outline of each apple in a mask. Touching apples are split at the neck between them."""
    return [outline for box, part in _components(mask) for outline in _split(part, box, mask.shape)]


def _components(mask: Mask) -> Iterator[tuple[tuple[int, int, int, int], Mask]]:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    for index in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[index])
        if area >= SMALLEST_PX:
            part = np.where(labels[top : top + height, left : left + width] == index, 255, 0).astype(np.uint8)
            yield (left, top, width, height), part


def _split(part: Mask, box: tuple[int, int, int, int], shape: tuple[int, ...]) -> Iterator[Outline]:
    padded = np.pad(part, 1)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 5).astype(np.float32)
    seeds = _seeds(depth)
    labels = _nearest(padded, depth, seeds)
    for index in range(1, len(seeds) + 1):
        own = np.where(labels == index, 255, 0).astype(np.uint8)
        if cv2.countNonZero(own) < SMALLEST_PX:
            continue
        yield _outline(own, (labels != index) & (labels > 0), box, shape)


def _outline(own: Mask, others: NDArray[np.bool_], box: tuple[int, int, int, int], shape: tuple[int, ...]) -> Outline:
    """Return the outline of a mask, except for the parts next to other apples. The masks have a margin of 1 pixel
    around the box."""
    pixels = _free_edge(own, others) + (np.array(box[:2]) - 1.0)
    inside = ((pixels >= BORDER_PX) & (pixels <= np.array(shape[1::-1]) - 1 - BORDER_PX)).all(axis=1)
    return Outline(pixels[inside], own[1:-1, 1:-1], box, cut=not bool(inside.all()))


def box_outline(box_px: FloatArray, shape: tuple[int, ...]) -> Outline | None:
    """Return the outline of an apple that fills a box (left, top, right, bottom). Returns None if the box is too small.

    ``shape`` is the height and width of the image.
    """
    low, high = box_px[:2], box_px[2:]
    corner = np.clip(np.floor(low), 0, np.array(shape[1::-1]) - 1).astype(int)
    end = np.clip(np.ceil(high), 1, np.array(shape[1::-1])).astype(int)
    width, height = (int(value) for value in end - corner)
    if width * height < SMALLEST_PX:
        return None
    turns = np.linspace(0.0, 2.0 * np.pi, BOX_POINTS, endpoint=False)
    around = 0.5 * (low + high) + 0.5 * (high - low) * np.column_stack([np.cos(turns), np.sin(turns)])
    cut = bool((low < 1.0).any() or (high > np.array(shape[1::-1]) - 1.0).any())
    mask = np.full((height, width), 255, np.uint8)
    return Outline(around, mask, (int(corner[0]), int(corner[1]), width, height), cut)


def rest(outline: Outline, covered: NDArray[np.bool_], shape: tuple[int, ...]) -> Outline | None:
    """Return the part of an outline next to an apple, if this part is large enough to be a partly hidden second apple.

    Args:
        outline: The outline.
        covered: Mask (height, width of the box) of the apple's pixels.
        shape: Height and width of the image.
    """
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    left = cv2.morphologyEx(np.where(covered, 0, outline.mask).astype(np.uint8), cv2.MORPH_OPEN, disk)
    parts = sorted(_components(np.asarray(left, dtype=np.uint8)), key=lambda part: cv2.countNonZero(part[1]))
    if not parts or cv2.countNonZero(parts[-1][1]) < max(SMALLEST_PX, LEAST_REST * covered.sum()):
        return None
    (x, y, width, height), part = parts[-1]
    box = (outline.box[0] + x, outline.box[1] + y, width, height)
    return _outline(np.pad(part, 1), np.pad(covered[y : y + height, x : x + width], 1), box, shape)


def _seeds(depth: FloatMap) -> list[tuple[int, int]]:
    """Return the deepest pixel (x, y) of each apple in a map of distances to the mask's edge."""
    left: FloatMap = np.array(cv2.GaussianBlur(depth, (5, 5), 1.0), dtype=np.float32)
    smooth, seeds = left.copy(), list[tuple[int, int]]()
    deepest = float(left.max())
    while True:
        y, x = (int(value) for value in np.unravel_index(int(left.argmax()), left.shape))
        if left[y, x] < LEAST_PART * deepest or left[y, x] <= 0.0:
            return seeds
        if all(_neck(smooth, (x, y), seed) < NECK * smooth[y, x] for seed in seeds):
            seeds.append((x, y))
        cv2.circle(left, (x, y), max(2, int(0.7 * smooth[y, x])), 0.0, cv2.FILLED)


def _neck(depth: FloatMap, one: tuple[int, int], other: tuple[int, int]) -> float:
    """Return the smallest half width of the mask between two pixels."""
    count = 2 + int(np.hypot(one[0] - other[0], one[1] - other[1]))
    x, y = (np.linspace(one[i], other[i], count).round().astype(int) for i in (0, 1))
    return float(depth[y, x].min())


def _nearest(mask: Mask, depth: FloatMap, seeds: list[tuple[int, int]]) -> NDArray[np.int64]:
    """Return, for each pixel, the number (from 1) of the nearest apple, where distances are relative to the apple's
    size."""
    y, x = np.indices(mask.shape, dtype=np.float32)
    distances = [np.hypot(x - seed[0], y - seed[1]) / float(depth[seed[1], seed[0]]) for seed in seeds]
    labels: NDArray[np.int64] = np.where(mask > 0, np.argmin(distances, axis=0) + 1, 0)
    return labels


def _free_edge(own: Mask, others: NDArray[np.bool_]) -> FloatArray:
    """Return the edge pixels (n, 2) of a mask that are not next to another apple, moved outward by half a pixel."""
    contours = cv2.findContours(own, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    contour = max(contours, key=cv2.contourArea).reshape(-1, 2)
    near = cv2.dilate(others.astype(np.uint8), np.ones((7, 7), np.uint8))
    free = contour[near[contour[:, 1], contour[:, 0]] == 0]
    middle = contour.mean(axis=0)
    away = free - middle
    lengths = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1.0)
    return np.asarray(free + 0.5 * away / lengths, dtype=np.float64)
