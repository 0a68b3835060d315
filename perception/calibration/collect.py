"""Collect views of a board from a stream of images, one view for each new pose in which the board is held still."""

from typing import Final

import numpy as np

from perception.calibration.board import BoardDetector, BoardView
from perception.frames import Picture
from perception.perception_errors import CalibrationRefused

STILL_PX: Final = 2.5
"""Maximum mean motion of the corners between two frames for the board to be considered still, in pixels."""
NEW_SHARE: Final = 0.05
"""Minimum mean distance of the corners from the corners of every earlier view, as a fraction of the image width."""


class ViewCollector:
    """Collector of distinct views of one board."""

    def __init__(self, detector: BoardDetector) -> None:
        self._detector = detector
        self._last: BoardView | None = None
        self.views: list[BoardView] = []

    def offer(self, picture: Picture, still: bool = True) -> bool:
        """Add a view if the image shows the board in a new pose.

        Args:
            picture: RGB image (height, width, 3).
            still: Whether the board must have been still since the previous image.

        Returns:
            Whether a view was added.
        """
        try:
            view = self._detector.view(picture)
        except CalibrationRefused:
            self._last = None
            return False
        last, self._last = self._last, view
        if still and (last is None or not distance_px(last, view) < STILL_PX):
            return False
        if any(distance_px(known, view) < NEW_SHARE * view.size[0] for known in self.views):
            return False
        self.views.append(view)
        return True


def distance_px(one: BoardView, other: BoardView) -> float:
    """Return the mean distance between the common corners of two views, in pixels, or infinity if there are none."""
    # The corners have the same positions on the board in all views.
    places = {tuple(place): pixel for place, pixel in zip(one.corners_m.round(5).tolist(), one.pixels, strict=True)}
    pairs = [
        (places[tuple(place)], pixel)
        for place, pixel in zip(other.corners_m.round(5).tolist(), other.pixels, strict=True)
        if tuple(place) in places
    ]
    if not pairs:
        return float("inf")
    return float(np.mean([np.linalg.norm(first - second) for first, second in pairs]))
