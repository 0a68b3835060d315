"""Plan a short path: one or two searches, each followed by shortcuts. The shorter result wins."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from hal.types import FloatArray, JointLimits
from planning.arm_model import ArmModel
from planning.collision import Collisions, Margins
from planning.errors import PlanningError
from planning.paths.request import PathRequest, Remaining, checked
from planning.paths.search import path_of_checked
from planning.paths.smoothing import path_length, shortened
from planning.paths.timing import TimedPath, timed

SEARCHES: Final = 2
"""Maximum number of searches. A single search may pass an obstacle on its long side."""
POSES: Final = 500
"""Number of checked poses after which no further search begins. A hard problem has a single search."""


class Plan(NamedTuple):
    """A path without contact."""

    points: FloatArray
    """Points of the path (m, n), in rad or m. Every edge between them is free."""
    margins: Margins
    """Margins that the path keeps: those of the request, or less if its start or its goal is nearer to something."""


def plan_path(
    arm: ArmModel, collisions: Collisions, request: PathRequest, remaining_s: Remaining, searches: int = SEARCHES
) -> Plan:
    """Plan a short path from the start to one of the goals.

    Args:
        arm: The arm.
        collisions: Checks of the arm in the scene.
        request: Start, goals, margins, planner and seed.
        remaining_s: Returns the time that is left, in seconds.
        searches: Number of searches from which the shortest path is taken. A path without corners ends the searches.

    Returns:
        The path and its margins.

    Raises:
        PlanningError: The start or the goals are not possible, or no path was found in time.
    """
    request, begun = checked(arm, collisions, request), collisions.poses_checked
    best: FloatArray | None = None
    for number in range(searches):
        again = PathRequest(
            request.start, request.goals, request.planner_id, request.margins, request.seed + 7919 * number
        )
        try:
            path = path_of_checked(arm, collisions, again, remaining_s)
        except PlanningError:
            if best is None:
                raise
            break
        path = shortened(path, collisions, request.margins, again.seed, remaining_s)
        if best is None or path_length(path) < path_length(best):
            best = path
        if len(path) == 2 or remaining_s() <= 0.0 or collisions.poses_checked - begun >= POSES:
            break
    assert best is not None
    return Plan(best, request.margins)


def plan_motion(
    arm: ArmModel,
    collisions: Collisions,
    request: PathRequest,
    remaining_s: Remaining,
    limits: Sequence[JointLimits] | None = None,
) -> TimedPath:
    """Plan a trajectory from the start to one of the goals.

    Args:
        arm: The arm.
        collisions: Checks of the arm in the scene.
        request: Start, goals, margins, planner and seed.
        remaining_s: Returns the time that is left, in seconds.
        limits: Limits of the joints (n), such as those of ``timing.scaled``; the arm's own limits if None.

    Raises:
        PlanningError: As ``plan_path`` does.
    """
    plan = plan_path(arm, collisions, request, remaining_s)
    return timed(plan.points, limits or arm.limits, collisions, plan.margins)
