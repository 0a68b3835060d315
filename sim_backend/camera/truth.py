"""True values of each apple in an image, as a reference for grading."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim_backend.camera.pinhole import PinholeCamera
from sim_backend.camera.skin import DEFECT, RED
from sim_backend.camera.view import FixedView, Sight

OCCLUDED: Final = 0.98
"""Visible fraction below which an apple is considered occluded."""


@dataclass(frozen=True, slots=True)
class AppleTruth:
    """Apple in an image. Fractions refer to the pixels that show the apple."""

    position_m: tuple[float, float, float]
    """Position of the apple's center in world coordinates, in meters."""
    diameter_mm: float
    red_ratio: float
    """Fraction of the skin that is red, meaning neither green nor a defect."""
    defect_score: float
    """Fraction of the skin that is brown or dark."""
    visible_share: float
    """Fraction of the apple's outline that is not hidden by other objects; 0.0 if the apple is not in the image."""
    cut: bool
    """Whether the edge of the image cuts the apple off."""
    box_px: tuple[int, int, int, int]
    """First column, first row, last column and last row of the pixels that show the apple (inclusive); all 0 if the
    apple is not visible."""

    @property
    def occluded(self) -> bool:
        """Whether part of the apple is cut off or hidden by another object."""
        return self.cut or self.visible_share < OCCLUDED


def truth_of(
    view: FixedView, camera: PinholeCamera, data: Any, sights: Sequence[Sight], geom: int, diameter_mm: float
) -> AppleTruth:
    """Return the true values of the apple that a geom represents in an image."""
    own = [sight.geom == geom for sight in sights]
    kinds = np.concatenate([sight.kind[mask] for sight, mask in zip(sights, own, strict=True)])
    count, alone = max(len(kinds), 1), max(view.alone(data, geom), 1)
    x, y, z = (float(value) for value in data.geom_xpos[geom])
    left, top, right, bottom = box = _box(np.any(own, axis=0).reshape(camera.height, camera.width))
    cut = len(kinds) > 0 and (left == 0 or top == 0 or right == camera.width - 1 or bottom == camera.height - 1)
    return AppleTruth(
        position_m=(x, y, z),
        diameter_mm=diameter_mm,
        red_ratio=float((kinds == RED).sum()) / count,
        defect_score=float((kinds == DEFECT).sum()) / count,
        visible_share=len(kinds) / alone,
        cut=cut,
        box_px=box,
    )


def _box(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return 0, 0, 0, 0
    return int(columns[0]), int(rows[0]), int(columns[-1]), int(rows[-1])
