"""Remove points of a path that are almost on the lines between the other points."""

import numpy as np

from hal.types import FloatArray


def thinned(path: FloatArray, levers_m: FloatArray, tolerance_m: float) -> FloatArray:
    """Return a path with fewer points (k, n), computed with the Douglas-Peucker algorithm.

    Args:
        path: Points (m, n), in rad or m.
        levers_m: Maximum motion of any geometry per motion of each joint (n,), in m/rad, with 1 for a slide.
        tolerance_m: Maximum motion of any geometry between a removed point and the new path, in m.
    """
    kept, waiting = {0, len(path) - 1}, [(0, len(path) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        distances_m = np.abs(_offsets(path[first : last + 1])) @ levers_m
        worst = int(np.argmax(distances_m))
        if distances_m[worst] > tolerance_m:
            middle = first + 1 + worst
            kept.add(middle)
            waiting += [(first, middle), (middle, last)]
    return path[sorted(kept)]


def _offsets(points: FloatArray) -> FloatArray:
    """Return the offsets (m - 2, n) of the inner points from the line between the ends."""
    line = points[-1] - points[0]
    inner = points[1:-1] - points[0]
    square = float(line @ line)
    shares = np.clip(inner @ line / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(inner))
    return np.asarray(inner - shares[:, None] * line)
