"""Plan a short path with one or two searches, each followed by shortcutting. The shorter result is used."""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray
from planning.arm_model import ArmModel
from planning.collision import Collisions
from planning.paths.blends import distinct
from planning.paths.margins import PathMargins
from planning.paths.release import ReleasedEnd, release
from planning.paths.request import PathRequest, Remaining, bounds, checked, reduced
from planning.paths.search import path_of_checked
from planning.paths.smoothing import path_length, shortened
from planning.planning_errors import PlanningError

SEARCHES: Final = 2
"""Maximum number of searches. A single search may find a path around the wrong side of an obstacle."""
POSES: Final = 500
"""Number of checked poses after which no further search begins, so that a difficult problem is searched only once."""
LEAST_M: Final = 2e-4
"""Minimum padding for a single-joint path, in m. The padding is not reduced below this value."""


class Plan(NamedTuple):
    """A path without contact."""

    points: FloatArray
    """Points of the path (m, n), in rad or m. Every edge between the points is free."""
    margins: PathMargins
    """Margins that the path keeps. Near a start or a goal that is close to an obstacle, the margins are smaller than in
    the request.
    """


def plan_path(
    arm: ArmModel, collisions: Collisions, request: PathRequest, remaining_s: Remaining, searches: int = SEARCHES
) -> Plan:
    """Plan a short path from the start to one of the goals.

    Args:
        arm: The arm.
        collisions: Checks of the arm in the scene.
        request: Start, goals, margins, planner and seed.
        remaining_s: Function that returns the remaining time, in seconds.
        searches: Maximum number of searches. The shortest path is used. If a path has no corners, no further search is
            run.

    Returns:
        The path and its margins.

    Raises:
        PlanningError: The start or the goals are invalid, or no path was found in time.
    """
    request = checked(arm, collisions, request)
    if len(request.start) == 1 and np.isfinite([arm.lower, arm.upper]).all():
        return _single(collisions, request)
    ends = _released(arm, collisions, request)
    if ends is None:
        request = reduced(collisions, request)
        return Plan(_shortest(arm, collisions, request, remaining_s, searches), PathMargins(request.margins))
    start, goals = ends
    inner = replace(request, start=start.free, goals=tuple(goal.free for goal in goals))
    points = _shortest(arm, collisions, inner, remaining_s, searches)
    goal = min(goals, key=lambda one: float(np.linalg.norm(one.free - points[-1])))
    return Plan(
        distinct(np.array([start.end, *points, goal.end])), PathMargins(request.margins, start.near + goal.near)
    )


def _single(collisions: Collisions, request: PathRequest) -> Plan:
    """Return the only possible path of a single joint, with margins as large as possible.

    Gripper jaws often pass a link of their own hand at a distance below the padding.
    """
    margins = request.margins
    while True:
        contacts = [collisions.edge_contact(request.start, goal, margins) for goal in request.goals]
        for goal, contact in zip(request.goals, contacts, strict=True):
            if contact is None:
                return Plan(np.array([request.start, goal]), PathMargins(margins))
        if margins.padding_m < LEAST_M and contacts[0] is not None:
            one, other = contacts[0].pair
            raise PlanningError(
                "PLANNING_FAILED",
                f"on the only path to the goal, {one} comes too close to {other}: move them apart, or allow them to "
                "touch",
            )
        margins = margins.within(margins.padding_m / 2.0)


def _released(
    arm: ArmModel, collisions: Collisions, request: PathRequest
) -> tuple[ReleasedEnd, list[ReleasedEnd]] | None:
    """Return poses that have the full padding near the start and near the goals, or None if there are none."""
    limits = bounds(arm, request)
    start = release(request.start, collisions, request.margins, limits, request.seed)
    if start is None:
        return None
    goals = [release(goal, collisions, request.margins, limits, request.seed) for goal in request.goals]
    found = [goal for goal in goals if goal is not None]
    return (start, found) if found else None


def _shortest(
    arm: ArmModel, collisions: Collisions, request: PathRequest, remaining_s: Remaining, searches: int
) -> FloatArray:
    """Return the shortest path (m, n) from several searches."""
    begun, best = collisions.poses_checked, None
    for number in range(searches):
        again = replace(request, seed=request.seed + 7919 * number)
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
    return best
