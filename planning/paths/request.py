"""A path request, and the checks of its start and its goals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from hal.types import FloatArray, JointLimits, far_outside
from planning.arm_model import ArmModel
from planning.collision import CONTACT_M, Collisions, Margins
from planning.planning_errors import Code, PlanningError

Remaining = Callable[[], float]
"""Function that returns the remaining time, in seconds. The package does not have its own clock."""
AROUND: Final = np.pi
"""Distance beyond the start and the goals that is searched for a continuous joint, in rad."""


@dataclass(frozen=True, slots=True)
class PathRequest:
    """Request for a path from one pose to the nearest of several goals. All arrays are in joint order (n,)."""

    start: FloatArray
    """Positions at the start (n,), in rad or m."""
    goals: tuple[FloatArray, ...]
    """Goal positions, each (n,). The path must reach one of the goals."""
    planner_id: str = ""
    """ID of MoveIt's planner, such as RRTConnectkConfigDefault. The default is RRT-Connect."""
    margins: Margins = field(default_factory=Margins)
    seed: int = 1
    """Seed of all random numbers, at least 1."""


def checked(arm: ArmModel, collisions: Collisions, request: PathRequest) -> PathRequest:
    """Return a request with only its valid goals, which are within the limits and free of contacts.

    If at least one goal has the full padding, all goals without the full padding are omitted.

    Raises:
        PlanningError: The start or every goal is outside the limits or in contact, or there is no goal.
    """
    if not request.goals:
        raise PlanningError("INVALID_GOAL_CONSTRAINTS", "the request has no goal: specify at least one pose")
    for name, position, limit in zip(arm.joints, request.start, arm.limits, strict=True):
        if not np.isfinite(position) or (wrong := far_outside(float(position), limit)):
            text = f"start: {name} {wrong}" if np.isfinite(position) else f"start: {name} is at {position}"
            raise PlanningError("START_STATE_INVALID", f"{text}: move the joint inside its limits first")
    _check_clear(collisions, request.start, "START_STATE_IN_COLLISION", "the start")
    within, outside = _inside(arm, request)
    if not within:
        raise PlanningError("INVALID_GOAL_CONSTRAINTS", f"goal: {outside}")
    distances = [collisions.clearance(goal).distance_m for goal in within]
    if max(distances) < CONTACT_M:
        _check_clear(collisions, within[int(np.argmax(distances))], "GOAL_IN_COLLISION", "the goal")
    possible = [goal for goal, distance_m in zip(within, distances, strict=True) if distance_m >= CONTACT_M]
    full = [goal for goal in possible if collisions.is_clear(goal, request.margins.padding_m)]
    return replace(request, goals=tuple(full or possible))


def reduced(collisions: Collisions, request: PathRequest) -> PathRequest:
    """Return a request with margins that the start and at least one goal satisfy. Only goals that satisfy the margins
    are kept."""
    padding_m = request.margins.padding_m
    rooms_m = [collisions.room_m(goal, padding_m) for goal in request.goals]
    margins = request.margins.within(min(collisions.room_m(request.start, padding_m), max(rooms_m)))
    goals = [goal for goal, room_m in zip(request.goals, rooms_m, strict=True) if room_m >= margins.padding_m]
    return replace(request, goals=tuple(goals), margins=margins)


def bounds(arm: ArmModel, request: PathRequest) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper bounds (n,) of the search, which are finite and include the start and the goals."""
    points = np.array([request.start, *request.goals])
    lower = np.where(np.isfinite(arm.lower), arm.lower, points.min(axis=0) - AROUND)
    upper = np.where(np.isfinite(arm.upper), arm.upper, points.max(axis=0) + AROUND)
    return np.minimum(lower, points.min(axis=0)), np.maximum(upper, points.max(axis=0))


def _inside(arm: ArmModel, request: PathRequest) -> tuple[list[FloatArray], str]:
    """Return the goals within the limits, and a description of the error in one of the other goals."""
    within, wrong = list[FloatArray](), ""
    for goal in request.goals:
        if outside := arm.outside(goal):
            wrong = outside
        else:
            within.append(_nearest_turn(np.asarray(goal, dtype=float), request.start, arm.limits))
    return within, wrong


def _nearest_turn(goal: FloatArray, start: FloatArray, limits: Sequence[JointLimits]) -> FloatArray:
    """Return the goal after adding full turns to continuous joints so that they are as close to the start as
    possible."""
    turns = np.round((start - goal) / (2.0 * np.pi)) * 2.0 * np.pi
    continuous = np.array([not np.isfinite(limit.upper) and not np.isfinite(limit.lower) for limit in limits])
    return np.where(continuous, goal + turns, goal)


def _check_clear(collisions: Collisions, positions: FloatArray, code: Code, place: str) -> None:
    clearance = collisions.clearance(positions)
    if clearance.distance_m < CONTACT_M:
        one, other = clearance.pair
        raise PlanningError(code, f"in {place}, {one} touches {other}: move them apart, or allow them to touch")
