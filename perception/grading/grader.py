"""Grade the apples in images from one calibrated camera."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray
from perception.camera_view import CameraView
from perception.frames import Picture
from perception.grading.edges import at_transitions
from perception.grading.light import Pixels, relative_to_table
from perception.grading.outlines import Outline, box_outline, colored, outlines, rest
from perception.grading.settings import GradingSettings
from perception.grading.skin import VisibleSkin, rim_px, skin_of
from perception.grading.spheres import AppleSphere, fit_sphere
from perception.perception_errors import PictureRefused

MOST_ERROR: Final = 0.12
"""Maximum mean deviation of an apple's outline from a circle, as a fraction of the radius."""
MOST_OUTLINES: Final = 100
"""Maximum number of outlines that are examined in an image."""
BESIDE: Final = 1.15
"""Squared relative distance from an apple's center beyond which a pixel belongs to another apple. The distance is 1 at
the outline."""
MOST_COVERED: Final = 0.015
"""Maximum fraction of an apple that may lack color, apart from spots inside its outline. If the fraction is larger,
another object, such as a finger, is in front of the apple."""
LEAST_SKIN: Final = 25
"""Minimum number of pixels required to assess the skin of an apple."""


@dataclass(frozen=True, slots=True, eq=False)
class GradedApple:
    """One apple in an image."""

    grade: str
    """Name of the grade, or empty if the apple has no grade."""
    diameter_mm: float
    red_ratio: float
    """Fraction of the visible surface that is red, from 0 to 1."""
    defect_score: float
    """Fraction of the visible surface that is dark or brown, from 0 to 1."""
    position_m: FloatArray
    """Center (3,) in base_link, in m."""
    box_px: tuple[int, int, int, int]
    """Left, top, width and height of the box in the image, in pixels."""
    reason: str = ""
    """Reason why the apple has no grade, or empty if it has a grade."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundBox:
    """An apple found by a detector."""

    box_px: FloatArray
    """Left, top, right and bottom edges (4,), in pixels."""
    grade: str
    """Grade of the apple, or empty if the detector does not assign one."""


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    outline: Outline
    sphere: AppleSphere
    range_m: float
    grade: str | None = None
    """Grade assigned by a detector, or None without a detector."""


class Grader:
    """Grader for images from one camera. Only one thread may use it."""

    def __init__(self, view: CameraView, settings: GradingSettings | None = None) -> None:
        """Prepare the grader.

        Args:
            view: Calibrated camera.
            settings: Grade thresholds and limits for apples. The default is ``GradingSettings``.
        """
        self._view = view
        self._settings = settings or GradingSettings()
        width, height = view.intrinsics.size
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        pixels = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
        self._rays = view.rays(pixels).reshape(height, width, 3)
        self._region = self._searched(pixels)

    def grade(self, picture: Picture) -> list[GradedApple]:
        """Grade all apples in an image.

        Args:
            picture: RGB image (height, width, 3) at the calibration resolution.

        Returns:
            The apples, closest to the camera first.

        Raises:
            PictureRefused: The image has the wrong resolution, or is black or overexposed.
        """
        relative = self._relative(picture)
        found = self._found(relative, outlines(colored(relative, self._region)))
        return [self._graded(relative, index, found) for index in range(len(found))]

    def grade_boxes(self, picture: Picture, boxes: Sequence[FoundBox]) -> list[GradedApple]:
        """Measure the apples found by a detector. The arguments and errors are the same as those of ``grade``."""
        relative = self._relative(picture)
        found = []
        for box in boxes:
            outline = box_outline(box.box_px, self._rays.shape[:2])
            sphere = None if outline is None else fit_sphere(self._view, outline.pixels)
            if outline is not None and sphere is not None and self._is_apple(sphere):
                found.append(_Found(outline, sphere, self._range_m(sphere), box.grade))
        found.sort(key=lambda one: one.range_m)
        return [self._graded(relative, index, found) for index in range(len(found))]

    def _relative(self, picture: Picture) -> Pixels:
        wanted = (self._view.intrinsics.height, self._view.intrinsics.width, 3)
        if picture.shape != wanted or picture.dtype != np.uint8:
            raise PictureRefused(
                f"the image has the shape {picture.shape} and the type {picture.dtype}, but the calibration is for "
                f"{wanted} uint8: calibrate at this resolution, or change the resolution of the camera"
            )
        return relative_to_table(picture, self._region)

    def _searched(self, pixels: FloatArray) -> NDArray[np.bool_] | None:
        """Return a mask (height, width) of the pixels that may show an apple in the configured region."""
        region = self._settings.region_m
        if region is None:
            return None
        places = self._view.on_plane(pixels)[:, :2]
        lowest, highest = np.array(region[:2]), np.array(region[2:])
        inside = ((places >= lowest) & (places <= highest)).all(axis=1)
        # An apple's outline also covers points of the plane behind the apple.
        eye = self._view.pose.position_m[:2]
        top_m = 1e-3 * self._settings.diameter_mm[1]
        above_m = self._view.pose.position_m[2] - self._view.pose.plane_height_m
        nearer = eye + (places - eye) * max(1.0 - top_m / above_m, 0.1)
        raised = ((nearer >= lowest) & (nearer <= highest)).all(axis=1)
        searched: NDArray[np.bool_] = inside | raised
        return searched.reshape(self._view.intrinsics.height, self._view.intrinsics.width)

    def _found(self, relative: Pixels, shapes: Sequence[Outline]) -> list[_Found]:
        """Return the outlines that represent apples, closest to the camera first."""
        found, left = [], list(shapes)
        for shape in left:
            outline = at_transitions(shape, relative)
            sphere = fit_sphere(self._view, outline.pixels)
            if sphere is None or sphere.error > MOST_ERROR:
                continue
            if self._is_apple(sphere):
                found.append(_Found(outline, sphere, self._range_m(sphere)))
                if len(left) < MOST_OUTLINES and (behind := self._behind(outline, sphere)):
                    left.append(behind)
        return sorted(found, key=lambda one: one.range_m)

    def _behind(self, outline: Outline, sphere: AppleSphere) -> Outline | None:
        """Return the visible part of an apple that is behind another apple of the same color, unless a neck separates
        the two."""
        left, top, width, height = outline.box
        rays = self._rays[top : top + height, left : left + width].reshape(-1, 3)
        covered = sphere.inside(rays)[1].reshape(height, width) < BESIDE
        return rest(outline, covered, self._rays.shape[:2])

    def _range_m(self, sphere: AppleSphere) -> float:
        return float(np.linalg.norm(sphere.center_m - self._view.pose.position_m))

    def _is_apple(self, sphere: AppleSphere) -> bool:
        """Return whether an object has the size of an apple and is in the region."""
        smallest, largest = self._settings.diameter_mm
        if not smallest <= 2000.0 * sphere.radius_m <= largest:
            return False
        if self._settings.region_m is None:
            return True
        x_min, y_min, x_max, y_max = self._settings.region_m
        x, y, _ = sphere.center_m
        return bool(x_min <= x <= x_max and y_min <= y <= y_max)

    def _graded(self, relative: Pixels, index: int, found: Sequence[_Found]) -> GradedApple:
        one = found[index]
        skin, visible, covered = self._skin(relative, one, found[:index])
        diameter_mm = 2000.0 * one.sphere.radius_m
        reason = ""
        if one.outline.cut:
            reason = "the edge of the image cuts it off"
        elif visible < self._settings.least_visible:
            reason = f"only {100.0 * visible:.0f} % of it is visible"
        elif covered > MOST_COVERED:
            reason = f"something in front of it covers {100.0 * covered:.0f} % of it"
        grade = one.grade
        if grade is None:
            grade = self._settings.grade_of(diameter_mm, skin.red_ratio, skin.defect_score)
        reason = reason or ("" if grade else "no grade covers its values")
        left, top, width, height = _box(one.outline)
        return GradedApple(
            "" if reason else grade, diameter_mm, skin.red_ratio, skin.defect_score, one.sphere.center_m,
            (left, top, width, height), reason,
        )  # fmt: skip

    def _skin(self, relative: Pixels, one: _Found, nearer: Sequence[_Found]) -> tuple[VisibleSkin, float, float]:
        """Return an apple's skin, the fraction not hidden by nearer apples, and the fraction covered by another
        object."""
        left, top, width, height = _grown(_box(one.outline), self._rays.shape)
        rows, columns = slice(top, top + height), slice(left, left + width)
        rays = self._rays[rows, columns].reshape(-1, 3)
        places, away = one.sphere.inside(rays)
        inside = (away < 1.0) & (rays @ one.sphere.frame[:, 2] > 0.0)
        free = inside.copy()
        for other in nearer:
            if not _overlap(_box(other.outline), (left, top, width, height)):
                continue
            free &= other.sphere.inside(rays)[1] > 1.1
        visible = float(free.sum()) / max(int(inside.sum()), 1)
        radius_px = np.sqrt(max(float(inside.sum()), 1.0) / np.pi)
        judged = free & (away < max(1.0 - rim_px(radius_px) / radius_px, 0.0) ** 2)
        if judged.sum() < LEAST_SKIN:
            return VisibleSkin(0.0, 0.0), 0.0, 0.0
        patch = relative[rows, columns]
        covered = float((colored(np.ascontiguousarray(patch)).ravel()[judged] == 0).mean())
        colors = patch.reshape(-1, 3)[judged].astype(np.float64) * self._settings.table_rgb
        return skin_of(colors, places[judged], judged.reshape(height, width)), visible, covered


def _box(outline: Outline) -> tuple[int, int, int, int]:
    """Return the left, top, width and height of an outline, in pixels."""
    rows, columns = np.flatnonzero(outline.mask.any(axis=1)), np.flatnonzero(outline.mask.any(axis=0))
    left, top = outline.box[0] + int(columns[0]), outline.box[1] + int(rows[0])
    return left, top, int(columns[-1] - columns[0]) + 1, int(rows[-1] - rows[0]) + 1


def _overlap(one: tuple[int, int, int, int], other: tuple[int, int, int, int]) -> bool:
    """Return whether two boxes (left, top, width, height) overlap."""
    apart_x = one[0] + one[2] <= other[0] or other[0] + other[2] <= one[0]
    apart_y = one[1] + one[3] <= other[1] or other[1] + other[3] <= one[1]
    return not (apart_x or apart_y)


def _grown(box: tuple[int, int, int, int], shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Return a box that is enlarged by a quarter of its size and clipped to an image of the given shape (height, width,
    …)."""
    left, top, width, height = box
    margin = max(width, height) // 4 + 2
    low_x, low_y = max(left - margin, 0), max(top - margin, 0)
    high_x, high_y = min(left + width + margin, shape[1]), min(top + height + margin, shape[0])
    return low_x, low_y, high_x - low_x, high_y - low_y
