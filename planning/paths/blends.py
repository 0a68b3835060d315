"""Round the corners of a path where the scene leaves room.

The path consists of straight lines and blends. A blend replaces a corner. Over a length h before and after the corner,
the direction turns from one line to the other along the curve 3x² - 2x³. The curvature therefore is 0 at both ends of
the blend.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hal.types import FloatArray
from planning.collision import Collisions
from planning.paths.margins import PathMargins

SHARE: Final = 0.45
"""Maximum fraction of a line that is replaced by a blend at one of its ends."""
HALVINGS: Final = 4
"""Number of times that a blend with contacts is halved before the corner is kept."""
CHORDS: Final = 16
"""Number of straight edges that represent a blend in the check."""
TURN: Final = 1.5
"""Maximum slope of the curve 3x² - 2x³ that describes how the direction turns."""
SAG: Final = 0.15
"""Maximum distance of a spline from its chord, as a multiple of the spline's curvature times the squared chord
length."""
SAME_RAD: Final = 1e-9
"""Distance below which two points are considered identical, in rad or m."""


@dataclass(frozen=True, slots=True)
class Corner:
    """Transition between two lines of a path. ``half`` is 0 if the path keeps its corner and stops there."""

    point: FloatArray
    """The corner (n,)."""
    before: FloatArray
    """Direction of the line before the corner, as a unit vector (n,)."""
    after: FloatArray
    """Direction of the line after the corner, as a unit vector (n,)."""
    half: float
    """Length that the blend replaces on the line at each side of the corner, in rad."""

    def sag(self, length: float) -> FloatArray:
        """Return the maximum distance (n,) of each joint from a chord of the given length on the blend, in rad or m.

        The distance between a curve of curvature k and a chord of length s is at most k s²/8. For a cubic spline with
        the same ends and end directions, the distance is at most 0.15 k s².
        """
        return SAG * length**2 * TURN / (2.0 * self.half) * np.abs(self.after - self.before)

    def at(self, along: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the position, direction and curvature (n,) at an arc length from the start of the blend, in rad."""
        x = along / (2.0 * self.half)
        turned, bent = 3.0 * x**2 - 2.0 * x**3, (6.0 * x - 6.0 * x**2) / (2.0 * self.half)
        moved = 2.0 * self.half * (x**3 - 0.5 * x**4)
        turn = self.after - self.before
        position = self.point + self.before * (along - self.half) + turn * moved
        return position, self.before + turn * turned, turn * bent


def distinct(path: FloatArray) -> FloatArray:
    """Return a path (m, n) without consecutive duplicate points."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    return path[np.concatenate(([True], steps > SAME_RAD))]


def blended(path: FloatArray, collisions: Collisions, margins: PathMargins) -> tuple[Corner, ...]:
    """Return the inner corners of a path (m, n), each with the longest contact-free blend."""
    lines = np.diff(path, axis=0)
    lengths = np.linalg.norm(lines, axis=1)
    directions = lines / lengths[:, None]
    corners = []
    for i in range(1, len(path) - 1):
        half = SHARE * float(min(lengths[i - 1], lengths[i]))
        corners.append(_blend(Corner(path[i], directions[i - 1], directions[i], half), collisions, margins))
    return tuple(corners)


def _blend(corner: Corner, collisions: Collisions, margins: PathMargins) -> Corner:
    for _ in range(HALVINGS):
        points = [corner.at(along)[0] for along in np.linspace(0.0, 2.0 * corner.half, CHORDS + 1)]
        sag_m = collisions.deviation_m(corner.sag(2.0 * corner.half / CHORDS))
        if margins.contact(collisions, points, np.full(CHORDS, sag_m)) is None:
            return corner
        corner = Corner(corner.point, corner.before, corner.after, corner.half / 2.0)
    return Corner(corner.point, corner.before, corner.after, 0.0)
