"""Find joint positions that move the tool into a region of poses (inverse kinematics)."""

import itertools
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from hal.types import FloatArray
from planning.kinematics.chain import Chain, pose_of
from planning.kinematics.descent import EXACT_M2, Descent, DescentEffort, descend
from planning.kinematics.goals import INSIDE, ROTATION_M, CollidingError, PoseGoal, UnreachableError
from planning.planning_errors import PlanningError

SAMPLES: Final = 1024
"""Number of random joint positions from which the starting points of a search are chosen."""
BATCHES: Final = (16, 32, 64)
"""Numbers of starting points in consecutive batches. A goal is rejected after the last batch."""
CENTER: Final = DescentEffort(steps=25, enough=8)
"""Effort limits for the search for the pose itself."""
REGION: Final = DescentEffort(steps=15, enough=8)
"""Effort limits for the additional search for the region, if the pose itself cannot be reached."""
WIDE: Final = DescentEffort(steps=40, enough=max(BATCHES))
"""Effort limits for the search for many poses in the region."""
DISTINCT: Final = 0.2
"""Minimum difference in at least one joint between two solutions, in rad or m."""
SAME: Final = 1e-3
"""If all joints differ by less than this value, a solution is not checked again, in rad or m."""
COUNT: Final = 8
"""Default maximum number of solutions."""

Remaining = Callable[[], float]
"""Function that returns the remaining time, in seconds."""
Valid = Callable[[FloatArray], bool]
"""Function that returns whether joint positions (n,) are valid, for example free of collisions."""


class InverseKinematics:
    """Solver for one chain. The same seed and request produce the same solutions."""

    def __init__(self, chain: Chain, seed: int = 0) -> None:
        """Choose random joint positions as starting points.

        Args:
            chain: Kinematics of the arm.
            seed: Seed for the random numbers.
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
        valid: Valid | None = None,
        count: int = COUNT,
        remaining_s: Remaining | None = None,
    ) -> FloatArray:
        """Find joint positions within the limits that move the tool into a region of poses.

        Args:
            goal: Region of tool poses.
            start: Current joint positions (n,), in rad or m. The current positions are tried first.
            valid: Function that returns whether joint positions are valid. By default, all positions are valid.
            count: Maximum number of solutions.
            remaining_s: Function that returns the remaining time, in seconds. By default, the time is not limited.

        Returns:
            Distinct solutions (k, n) in rad or m, with k from 1 to ``count``. The solution closest to ``start`` comes
            first.

        Raises:
            UnreachableError: No joint positions were found. The error contains the nearest pose.
            CollidingError: Joint positions were found, but none are valid.
            PlanningError: ``start`` is invalid, or no time is left.
        """
        first = self._chain.checked(start)
        nearest: list[Descent] = []
        colliding: list[FloatArray] = []
        for starts in self._batches(goal, first):
            if nearest and remaining_s is not None and remaining_s() <= 0.0:
                raise PlanningError(
                    "TIMED_OUT", f"no joint positions for {self._chain.tool} were found in time: allow more time"
                )
            found = self._widely(goal, starts) if colliding else self._search(goal, starts)
            reached = self._from_start(self._reached(goal, found), start)
            solutions = _distinct(reached, valid, count)
            if len(solutions):
                return solutions
            colliding.extend(reached[:1])
            nearest.append(found)
        if colliding:
            raise CollidingError(
                f"{self._chain.tool} reaches the goal only at invalid joint positions, for example in collision: move "
                "the goal or the obstacle",
                colliding[0],
            )
        raise self._unreachable(goal, nearest)

    def _batches(self, goal: PoseGoal, first: FloatArray) -> list[FloatArray]:
        """Return batches of starting points (k, n): the given starting point, then samples.

        Half of the samples are those nearest to the goal.
        """
        weighted = goal.distances(self._tools) * (1.0, ROTATION_M)
        near = self._samples[np.argsort((weighted**2).sum(axis=1), kind="stable")]
        batches = []
        for end, size in zip(itertools.accumulate(BATCHES), BATCHES, strict=True):
            part = slice((end - size) // 2, end // 2)
            batches.append(np.concatenate([near[part], self._samples[part]]))
        return [np.concatenate([first[None], batches[0]]), *batches[1:]]

    def _search(self, goal: PoseGoal, starts: FloatArray) -> Descent:
        """Move the starting points to the pose itself or, if none of them reaches it, to the region around it."""
        found = descend(self._chain, goal, starts, 0.0, CENTER)
        if not goal.contains(self._chain.transforms(found.positions)).any():
            found = descend(self._chain, goal, found.positions, INSIDE, REGION)
        return found

    def _widely(self, goal: PoseGoal, starts: FloatArray) -> Descent:
        """Move the starting points to different poses in the region, because the pose itself is in collision."""
        return descend(self._chain, goal, starts, INSIDE, WIDE)

    def _reached(self, goal: PoseGoal, found: Descent) -> FloatArray:
        """Return the joint positions (k, n) inside the region, or only the exact solutions if there are any."""
        inside = goal.contains(self._chain.transforms(found.positions))
        exact = inside & (found.cost_m2 <= EXACT_M2)
        return found.positions[exact if exact.any() else inside]

    def _from_start(self, positions: FloatArray, start: FloatArray) -> FloatArray:
        """Return joint positions (k, n) without unnecessary turns, sorted by their distance from ``start``."""
        turns = 2.0 * np.pi * np.round((positions - start) / (2.0 * np.pi)) * self._chain.periodic
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
            f"away, at x {x:.3f}, y {y:.3f}, z {z:.3f}. Move the goal to this pose or widen its tolerances"
        )
        return UnreachableError(message, pose, positions, (distance_m, angle_rad))


def _distinct(positions: FloatArray, valid: Valid | None, count: int) -> FloatArray:
    """Return the first ``count`` joint positions that are valid and differ from one another."""
    found: list[FloatArray] = []
    refused: list[FloatArray] = []
    for one in positions:
        if len(found) == count:
            break
        if _is_near(one, found, DISTINCT) or _is_near(one, refused, SAME):
            continue
        (found if valid is None or valid(one) else refused).append(one)
    return np.array(found).reshape(-1, positions.shape[1])


def _is_near(one: FloatArray, others: Sequence[FloatArray], distance: float) -> bool:
    return any(float(np.abs(one - other).max()) < distance for other in others)
