"""Shorten a path with shortcuts whose edges are checked."""

from typing import Final

import numpy as np

from hal.types import FloatArray
from planning.collision import Collisions, Margins
from planning.paths.request import Remaining

TRIES: Final = 400
"""Maximum number of shortcuts to try."""
PATIENCE: Final = 30
"""Number of consecutive shortcuts that must fail before the path is considered short."""
GAIN: Final = 1e-3
"""Minimum fraction of the path length that a shortcut must save."""


def path_length(path: FloatArray) -> float:
    """Return the length of a path (m, n): the sum of the Euclidean lengths of its edges, in rad (m for slides)."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def shortened(
    path: FloatArray, collisions: Collisions, margins: Margins, seed: int, remaining_s: Remaining
) -> FloatArray:
    """Return a shorter path with the same ends.

    All edges of the result are free if the edges of the given path are free.

    Args:
        path: Points (m, n), in rad or m.
        collisions: Checks of the arm in the scene.
        margins: Padding and tolerance of the edges.
        seed: Seed for the random shortcuts.
        remaining_s: Function that returns the remaining time, in seconds. When no time is left, the current path is
            returned.
    """
    random = np.random.default_rng(seed)
    path, failed = _without_detours(path, collisions, margins), 0
    for _ in range(TRIES):
        if len(path) < 3 or failed >= PATIENCE or remaining_s() <= 0.0:
            break
        found = _shortcut(path, collisions, margins, random)
        failed = failed + 1 if found is None else 0
        path = path if found is None else found
    return path


def _without_detours(path: FloatArray, collisions: Collisions, margins: Margins) -> FloatArray:
    """Connect each point directly to the farthest later point that can be reached."""
    kept, at = [0], 0
    while at < len(path) - 1:
        after = len(path) - 1
        while after > at + 1 and collisions.edge_contact(path[at], path[after], margins) is not None:
            after = at + max(1, (after - at) // 2)
        kept.append(after)
        at = after
    return path[kept]


def _shortcut(
    path: FloatArray, collisions: Collisions, margins: Margins, random: np.random.Generator
) -> FloatArray | None:
    """Return the path with a straight edge between two random points on it, or None if the edge saves too little length
    or is not free."""
    ends = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    low, high = np.sort(random.uniform(0.0, ends[-1], 2))
    first, last = int(np.searchsorted(ends, low, "right")) - 1, int(np.searchsorted(ends, high, "right")) - 1
    if first == last:
        return None
    points = [
        path[i] + (path[i + 1] - path[i]) * (at - ends[i]) / (ends[i + 1] - ends[i])
        for i, at in ((first, low), (last, high))
    ]
    if high - low - float(np.linalg.norm(points[1] - points[0])) < GAIN * ends[-1]:
        return None
    if collisions.edge_contact(points[0], points[1], margins) is not None:
        return None
    # Segments of checked edges are free and do not need to be checked again.
    return np.concatenate([path[: first + 1], points, path[last + 1 :]])
