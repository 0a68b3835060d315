"""Convert the goals of a request to joint positions of a group."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from hal.types import FloatArray
from planning.collision import CONTACT_M, Collisions, Margins
from planning.kinematics.chain import Chain
from planning.kinematics.goals import CollidingError, PoseGoal
from planning.kinematics.inverse import InverseKinematics, Remaining, Valid
from planning.motion import Goal, JointGoal, no_goal
from planning.planning_errors import PlanningError
from planning.scene import Pose

SAMPLES: Final = 16
"""Number of random positions, in addition to the goal itself, that represent a joint goal with tolerances."""
WIDE: Final = 1e-3
"""Minimum tolerance at which a joint goal is treated as a range of positions, in rad or m."""

ChainOf = Callable[[str | None, Pose], Chain]
"""Function that returns the chain to a frame, given the frame's pose relative to a link, or to the group's tip if
None."""


class GroupGoals:
    """Joint positions of a group that reach a goal.

    Args:
        joints: Names of the joints (n).
        ends: Lower and upper position limits, each (n,), in rad or m.
        chain_of: Function that returns the chain to a link.
        seed: Seed for all random numbers.
        remaining_s: Function that returns the remaining time, in seconds. If None, the time is not limited.
    """

    def __init__(
        self,
        joints: Sequence[str],
        ends: tuple[FloatArray, FloatArray],
        chain_of: ChainOf,
        seed: int,
        remaining_s: Remaining | None = None,
    ) -> None:
        self._joints = tuple(joints)
        self._lower, self._upper = ends
        self._chain_of, self._seed, self._remaining_s = chain_of, seed, remaining_s

    def positions(
        self, goals: Sequence[Goal], start: FloatArray, collisions: Collisions, margins: Margins
    ) -> list[FloatArray]:
        """Return positions (n,), each of which reaches one of the goals.

        An unreachable goal is omitted if another goal can be reached.

        Raises:
            PlanningError: None of the goals can be reached. The error of the first goal is raised.
        """
        found: list[FloatArray] = []
        errors: list[PlanningError] = []
        for goal in goals:
            try:
                if isinstance(goal, JointGoal):
                    found += self._of_joints(goal, start)
                else:
                    chain = self._chain_of(goal.link, goal.offset)
                    found += self.of_pose(chain, goal.goal, start, (collisions, margins))
            except PlanningError as error:
                errors.append(error)
        if found:
            return found
        raise errors[0] if errors else no_goal()

    def of_pose(
        self,
        chain: Chain,
        goal: PoseGoal,
        start: FloatArray,
        checks: tuple[Collisions, Margins] | None,
        kept: Valid = lambda _: True,
    ) -> list[FloatArray]:
        """Return joint positions (n,) of the group that move a link to a pose, those closest to ``start`` first.

        Solutions whose clearance is below the padding are used only if there are no others. ``kept`` returns whether
        positions are allowed, apart from contacts. Raises PlanningError.
        """
        own = [self._joints.index(name) for name in chain.names]

        def whole(positions: FloatArray) -> FloatArray:
            full = start.copy()
            full[own] = positions
            return full

        def solutions(clear: Valid) -> list[FloatArray]:
            def valid(positions: FloatArray) -> bool:
                full = whole(positions)
                return clear(full) and kept(full)

            solver = InverseKinematics(chain, self._seed)
            found = solver.solve(goal, start[own], valid=valid, remaining_s=self._remaining_s)
            return [whole(one) for one in found]

        if checks is None:
            return solutions(lambda _: True)
        collisions, margins = checks
        try:
            return solutions(lambda one: collisions.is_clear(one, margins.padding_m))
        except CollidingError:
            pass
        try:
            return solutions(lambda one: collisions.is_clear(one, CONTACT_M))
        except CollidingError as error:
            contacts = collisions.nearer(whole(error.positions), CONTACT_M)
            if not contacts:
                raise
            one, other = contacts[0].pair
            raise CollidingError(
                f"every joint position found for the goal is in collision (for example, {one} touches {other}): move "
                f"the goal or the obstacle",
                error.positions,
            ) from error

    def _of_joints(self, goal: JointGoal, start: FloatArray) -> list[FloatArray]:
        target, below, above = start.copy(), np.zeros(len(start)), np.zeros(len(start))
        for name, position in goal.positions.items():
            if name not in self._joints:
                raise PlanningError(
                    "INVALID_GOAL_CONSTRAINTS",
                    f"the goal contains joint {name}, which is not in the group: choose from {', '.join(self._joints)}",
                )
            if not np.isfinite(position):
                raise PlanningError(
                    "INVALID_GOAL_CONSTRAINTS", f"the goal for {name} is {position}: send a finite number"
                )
            joint = self._joints.index(name)
            target[joint] = position
            below[joint], above[joint] = goal.tolerances.get(name, (0.0, 0.0))
        return self._within(target, below, above)

    def _within(self, target: FloatArray, below: FloatArray, above: FloatArray) -> list[FloatArray]:
        """Return the goal and random positions within wide tolerances.

        A goal outside the limits is moved to the limits if its tolerances allow this.
        """
        lowest, highest = np.maximum(target - below, self._lower), np.minimum(target + above, self._upper)
        possible = lowest <= highest
        nearest = np.where(possible, np.clip(target, np.minimum(lowest, highest), highest), target)
        if not possible.all() or (highest - lowest).max(initial=0.0) < WIDE:
            return [nearest]
        return [nearest, *np.random.default_rng(self._seed).uniform(lowest, highest, (SAMPLES, len(target)))]
