"""Leave a start, or reach a goal, whose clearance is below the padding.

Only the edge between such an end and a nearby pose with the full padding has smaller margins.
"""

from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray
from planning.collision import Collisions, Margins
from planning.paths.margins import Near

RADII: Final = (0.02, 0.05, 0.1, 0.2, 0.4)
"""Distances at which to search for a pose with the full padding, in rad."""
TRIES: Final = 40
"""Number of random poses at each distance."""
BEYOND: Final = 1.5
"""Radius of the area with smaller margins, as a multiple of the distance to the pose with the full padding."""


class ReleasedEnd(NamedTuple):
    """An end of a path, and the pose from which the path keeps its full margins."""

    end: FloatArray
    """The start or the goal (n,), in rad or m."""
    free: FloatArray
    """Pose (n,) with the full padding, which is the end itself if the end has the full padding."""
    near: tuple[Near, ...] = ()
    """Margins near the end."""


def release(
    end: FloatArray, collisions: Collisions, margins: Margins, ends: tuple[FloatArray, FloatArray], seed: int
) -> ReleasedEnd | None:
    """Return a pose near an end of a path that has the full padding, or None if no such pose was found.

    Args:
        end: The start or the goal (n,), in rad or m.
        collisions: Checks of the arm in the scene.
        margins: Margins of the path.
        ends: Lower and upper position limits, each (n,).
        seed: Seed for the random poses.
    """
    if collisions.is_clear(end, margins.padding_m):
        return ReleasedEnd(end, end)
    own = margins.within(collisions.room_m(end, margins.padding_m))
    random = np.random.default_rng(seed)
    for radius in RADII:
        for _ in range(TRIES):
            direction = random.normal(size=len(end))
            free = np.clip(end + radius * direction / np.linalg.norm(direction), *ends)
            if not collisions.is_clear(free, margins.padding_m) or collisions.edge_contact(end, free, own):
                continue
            return ReleasedEnd(end, free, (Near(end, BEYOND * float(np.linalg.norm(free - end)), own),))
    return None
