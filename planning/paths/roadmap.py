"""Search in a roadmap of random poses (PRM) whose edges are checked only when a path needs them.

OMPL's own PRM is not used, because it needs a second thread and its roadmap depends on the speed of the machine.
"""

import heapq
import itertools
from typing import Final

import numpy as np

from hal.types import FloatArray
from planning.collision import Collisions
from planning.paths.request import PathRequest, Remaining

BATCH: Final = 150
"""Number of random poses to add if the roadmap does not contain a path."""
NEIGHBORS: Final = 10
"""Number of nearest poses to which each pose is connected."""
MOST: Final = 1_000
"""Maximum number of poses in a roadmap."""


class _Roadmap:
    """Roadmap of poses and edges. Pose 0 is the start, followed by the goals."""

    def __init__(self, collisions: Collisions, request: PathRequest) -> None:
        self.poses = np.array([request.start, *request.goals])
        self.goals = range(1, len(request.goals) + 1)
        self._collisions, self._margins = collisions, request.margins
        self._free: dict[tuple[int, int], bool] = {}
        self._edges: list[dict[int, float]] = []

    def grow(self, random: np.random.Generator, ends: tuple[FloatArray, FloatArray]) -> None:
        """Add random poses, and connect each pose to the nearest poses."""
        samples = random.uniform(*ends, (BATCH, len(ends[0])))
        clear = [pose for pose in samples if self._collisions.is_clear(pose, self._margins.padding_m)]
        self.poses = np.array([*self.poses, *clear])
        self._edges = [{} for _ in self.poses]
        for i, pose in enumerate(self.poses):
            lengths = np.linalg.norm(self.poses - pose, axis=1)
            for j in np.argsort(lengths, kind="stable")[1 : NEIGHBORS + 1].tolist():
                if self._free.get((min(i, j), max(i, j)), True):
                    self._edges[i][j] = self._edges[j][i] = float(lengths[j])

    def path(self, remaining_s: Remaining) -> FloatArray | None:
        """Return the shortest free path in the roadmap, or None if there is none or no time is left."""
        while remaining_s() > 0.0 and (nodes := self._shortest()):
            if all(self._check(i, j) for i, j in itertools.pairwise(nodes)):
                return self.poses[nodes]
        return None

    def _check(self, i: int, j: int) -> bool:
        key = (min(i, j), max(i, j))
        if key not in self._free:
            contact = self._collisions.edge_contact(self.poses[key[0]], self.poses[key[1]], self._margins)
            self._free[key] = contact is None
            if contact is not None:
                del self._edges[i][j], self._edges[j][i]
        return self._free[key]

    def _shortest(self) -> list[int]:
        """Return the shortest path through edges that are free or unchecked (Dijkstra), or an empty list."""
        before, best, waiting = {0: -1}, {0: 0.0}, [(0.0, 0)]
        while waiting:
            length, node = heapq.heappop(waiting)
            if node in self.goals:
                nodes = [node]
                while nodes[-1] != 0:
                    nodes.append(before[nodes[-1]])
                return nodes[::-1]
            if length > best[node]:
                continue
            for other, step in self._edges[node].items():
                if length + step < best.get(other, np.inf):
                    best[other], before[other] = length + step, node
                    heapq.heappush(waiting, (length + step, other))
        return []


def roadmap_path(
    collisions: Collisions,
    request: PathRequest,
    ends: tuple[FloatArray, FloatArray],
    seed: int,
    remaining_s: Remaining,
) -> FloatArray | None:
    """Search for a path in a growing roadmap.

    Args:
        collisions: Checks of the arm in the scene.
        request: Start, goals and margins.
        ends: Lower and upper bounds for the random poses, each (n,).
        seed: Seed of the random poses.
        remaining_s: Function that returns the remaining time, in seconds.

    Returns:
        Points of the path (m, n), or None.
    """
    random, roadmap = np.random.default_rng(seed), _Roadmap(collisions, request)
    while remaining_s() > 0.0 and len(roadmap.poses) < MOST:
        roadmap.grow(random, ends)
        if (path := roadmap.path(remaining_s)) is not None:
            return path
    return None
