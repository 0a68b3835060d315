"""Move an apple's outline to the middle of the transition between its color and the color of its surroundings.

The mask of colored pixels ends where the color no longer differs enough from the table. In a blurred image, the mask's
edge is outside an apple that is brighter than the table, and inside an apple that is darker.
"""

from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from hal.types import FloatArray
from perception.grading.light import Pixels
from perception.grading.outlines import Outline

REACH_PX: Final = 4.0
"""Distance inside and outside the outline within which to search for the transition, in pixels."""
STEP_PX: Final = 0.25
"""Distance between the samples across the outline, in pixels."""
ENDS: Final = 5
"""Number of samples at each end that are averaged to determine the colors of the apple and its surroundings."""
LEAST_CONTRAST: Final = 0.1
"""Minimum difference between the two colors at which a point of the outline is moved, as a fraction of the brighter
color."""


def at_transitions(outline: Outline, relative: Pixels) -> Outline:
    """Return the outline with its points (n, 2) moved to the color transitions in an image.

    Args:
        outline: The outline, which must be within about 3 pixels of the transitions.
        relative: Linear RGB (height, width, 3), relative to the table.
    """
    pixels = outline.pixels
    if not len(pixels):
        return outline
    away = pixels - pixels.mean(axis=0)
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1.0)
    offsets = np.arange(-REACH_PX, REACH_PX + STEP_PX, STEP_PX)
    samples = _sampled(relative, pixels[:, np.newaxis] + offsets[:, np.newaxis] * away[:, np.newaxis])
    inner, outer = samples[:, :ENDS].mean(axis=1), samples[:, -ENDS:].mean(axis=1)
    step = inner - outer
    height = (step * step).sum(axis=1)
    shares = ((samples - outer[:, np.newaxis]) * step[:, np.newaxis]).sum(axis=2) / np.maximum(height, 1e-9)[:, None]
    clear = height > (LEAST_CONTRAST * np.maximum(inner, outer).max(axis=1)) ** 2
    moved = np.where(clear, _crossing(shares, offsets), 0.0)
    return replace(outline, pixels=pixels + moved[:, np.newaxis] * away)


def _sampled(relative: Pixels, places: FloatArray) -> FloatArray:
    """Return the colors (n, m, 3) of an image at the pixels (n, m, 2)."""
    x, y = (np.ascontiguousarray(places[..., i], dtype=np.float32) for i in (0, 1))
    return np.asarray(cv2.remap(relative, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float64)


def _crossing(shares: FloatArray, offsets: FloatArray) -> FloatArray:
    """Return the outermost offset (n,) at which the fraction (n, m) of the inner color falls to one half."""
    above = shares > 0.5
    last = shares.shape[1] - 1 - np.argmax(above[:, ::-1], axis=1)
    last = np.clip(last, 0, shares.shape[1] - 2)
    rows = np.arange(len(shares))
    here, beyond = shares[rows, last], shares[rows, last + 1]
    part = np.clip((here - 0.5) / np.maximum(here - beyond, 1e-9), 0.0, 1.0)
    return np.asarray(offsets[last] + part * STEP_PX)
