"""Inverse kinematics: joint positions that bring the tool into a region of poses."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from hal.types import FloatArray
from planning.kinematics.chain import Chain, pose_of
from planning.kinematics.descent import Descent, descend
from planning.kinematics.goals import INSIDE, ROTATION_M, CollidingError, PoseGoal, UnreachableError

SAMPLES: Final = 2048
"""Number of random joint positions from which the starts of a search are chosen."""
BATCH: Final = 24
"""Number of starts that are computed at once."""
BATCHES: Final = 12
"""Maximum number of batches of a search. A goal is refused after the last one."""
CENTER_STEPS: Final = 25
"""Maximum number of steps toward the pose itself."""
REGION_STEPS: Final = 15
"""Maximum number of further steps toward the region, from where the pose itself cannot be reached."""
DISTINCT: Final = 0.2
"""Smallest difference of a joint between two solutions, in rad or m."""
COUNT: Final = 8
"""Default for the maximum number of solutions."""

Valid = Callable[[FloatArray], bool]
"""Returns whether joint positions (n,) are valid, for example free of collisions."""


class InverseKinematics:
    """Solver for one chain. The same seed and request give the same solutions."""

    def __init__(self, chain: Chain, seed: int = 0) -> None:
        """Choose random joint positions as starts.

        Args:
            chain: Kinematics of the arm.
            seed: Seed of the random numbers.
        """
        self._chain = chain
        lower = np.where(np.isfinite(chain.lower), chain.lower, -np.pi)
        upper = np.where(np.isfinite(chain.upper), chain.upper, np.pi)
        self._samples = np.random.default_rng(seed).uniform(lower, upper, (SAMPLES, len(lower)))
        self._tools = chain.transforms(self._samples)

    def solve(
        self,
        goal: PoseGoal,
        start: FloatArray,
        seeds: Sequence[FloatArray] = (),
        valid: Valid | None = None,
        count: int = COUNT,
    ) -> FloatArray:
        """Find joint positions within the limits that bring the tool into a region of poses.

        Args:
            goal: Region of poses of the tool.
            start: Current joint positions (n,), in rad or m. They are tried first.
            seeds: Further joint positions (n,) to try first.
            valid: Returns whether joint positions are valid; by default, all are.
            count: Maximum number of solutions.

        Returns:
            Distinct solutions (k, n) in rad or m, with k from 1 to ``count``. The nearest to ``start`` is first.

        Raises:
            UnreachableError: No joint positions were found. The error has the nearest pose.
            CollidingError: Joint positions were found, but none are valid.
        """
        nearest: list[Descent] = []
        colliding: list[FloatArray] = []
        for starts in self._batches(goal, [start, *seeds]):
            found = self._search(goal, starts)
            inside = goal.contains(self._chain.transforms(found.positions))
            reached = self._from_start(found.positions[inside], start)
            solutions = _distinct(reached, valid, count)
            if len(solutions):
                return solutions
            colliding.extend(reached[:1])
            nearest.append(found)
        if colliding:
            raise CollidingError("the goal can be reached only in collision: move the goal or the obstacle", colliding[0])
        raise self._unreachable(goal, nearest)

    def _batches(self, goal: PoseGoal, first: Sequence[FloatArray]) -> list[FloatArray]:
        """Return batches of starts (k, n): the given ones, then samples, of which half are the nearest to the goal."""
        weighted = goal.distances(self._tools) * (1.0, ROTATION_M)
        near = self._samples[np.argsort((weighted**2).sum(axis=1), kind="stable")]
        half = BATCH // 2
        batches = [
            np.concatenate([near[half * i : half * (i + 1)], self._samples[half * i : half * (i + 1)]])
            for i in range(BATCHES)
        ]
        return [np.concatenate([np.array(first), batches[0]]), *batches[1:]]

    def _search(self, goal: PoseGoal, starts: FloatArray) -> Descent:
        """Move the starts to the pose itself, and those that do not reach it to the region around it."""
        found = descend(self._chain, goal, starts, 0.0, CENTER_STEPS)
        outside = np.flatnonzero(~goal.contains(self._chain.transforms(found.positions)).astype(bool))
        if len(outside):
            region = descend(self._chain, goal, found.positions[outside], INSIDE, REGION_STEPS)
            found.positions[outside], found.cost_m2[outside] = region.positions, region.cost_m2
        return found

    def _from_start(self, positions: FloatArray, start: FloatArray) -> FloatArray:
        """Return joint positions (k, n) without needless turns, sorted by their distance from ``start``."""
        turns = 2.0 * np.pi * np.round((positions - start) / (2.0 * np.pi)) * self._chain.turns
        turned = positions - turns
        allowed = (turned >= self._chain.lower) & (turned <= self._chain.upper)
        positions = np.where(allowed, turned, positions)
        return positions[np.argsort(np.linalg.norm(positions - start, axis=1), kind="stable")]

    def _unreachable(self, goal: PoseGoal, nearest: Sequence[Descent]) -> UnreachableError:
        costs = np.concatenate([found.cost_m2 for found in nearest])
        positions = np.concatenate([found.positions for found in nearest])[np.argmin(costs)]
        tool = self._chain.transforms(positions[None])
        distance_m, angle_rad = goal.distances(tool)[0].tolist()
        pose = pose_of(tool[0])
        x, y, z = pose.position_m.tolist()
        message = (
            f"{self._chain.tool} cannot reach the goal: the nearest pose is {distance_m:.3f} m and {angle_rad:.2f} rad "
            f"away, at x {x:.3f}, y {y:.3f}, z {z:.3f}; move the goal there or widen its tolerances"
        )
        return UnreachableError(message, pose, positions, (distance_m, angle_rad))


def _distinct(positions: FloatArray, valid: Valid | None, count: int) -> FloatArray:
    """Return the first ``count`` joint positions that are valid and differ from one another."""
    found: list[FloatArray] = []
    for one in positions:
        if len(found) == count:
            break
        if all(np.abs(one - other).max() >= DISTINCT for other in found) and (valid is None or valid(one)):
            found.append(one)
    return np.array(found).reshape(-1, positions.shape[1])
