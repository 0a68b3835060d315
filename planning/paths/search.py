"""Search for contact-free paths with OMPL.

OMPL's random number generator is global in a process. Every attempt reseeds the generator with a seed from the request,
so that consecutive requests do not influence each other. Simultaneous requests in one process would influence each
other, so a caller with several threads must run one search at a time. At exit, OMPL's Python module prints all of its
objects that are still alive. The callbacks in this module do not keep references to OMPL's objects, so objects do not
outlive their search. After gc.freeze(), OMPL's types would stay alive, because the final garbage collection skips them.
This module therefore calls gc.unfreeze() at exit.
"""

import atexit
import gc
from collections.abc import Iterator
from itertools import count
from typing import Any, Final, NamedTuple

import numpy as np
from ompl import base, geometric, util

from hal.types import FloatArray
from planning.arm_model import ArmModel
from planning.collision import Collisions, Margins
from planning.paths.request import PathRequest, Remaining, bounds, checked, reduced
from planning.paths.roadmap import roadmap_path
from planning.planning_errors import PlanningError

atexit.register(gc.unfreeze)

PLANNERS: Final = {
    "rrtconnect": geometric.RRTConnect,
    "rrtstar": geometric.RRTstar,
    "kpiece": geometric.KPIECE1,
    "bkpiece": geometric.BKPIECE1,
    "lbkpiece": geometric.LBKPIECE1,
}
"""OMPL planners, keyed by the lowercase stem of MoveIt's planner IDs."""
PRM: Final = "prm"
"""Planner ID stem of the planner in planning/paths/roadmap.py."""
DEFAULT: Final = "rrtconnect"
NARROW: Final = "lbkpiece"
"""Planner that the default planner uses in every second attempt."""
RANGES_RAD: Final = (1.0, 0.5, 2.0)
"""Maximum edge lengths that the attempts use in turn, in rad (m for a slide)."""
EDGES: Final = 150
"""Maximum number of edges that the first attempt checks. Later attempts check more edges."""
NARROW_FACTOR: Final = 6
"""Factor applied to the number of edges for ``NARROW``. This planner checks an edge only after its tree has reached the
goal. The planner's edges are therefore cheaper, but more of them are needed: a median of 650 for a goal in a cage.
"""
IMPROVING_EDGES: Final = 5_000
"""Number of edges that RRTstar checks, even if it already has a path."""
GROWTH: Final = 1.5
"""Factor by which the number of edges grows with each attempt."""


class Attempt(NamedTuple):
    """One run of a planner."""

    planner: str
    range_rad: float
    edges: int
    """Maximum number of edges to check."""
    seed: int


def planner_stem(planner_id: str) -> str | None:
    """Return ``PRM`` or the key in ``PLANNERS`` for a MoveIt planner ID, or None if the planner does not exist.

    A group name may precede an ID, as in ``arm[PRMkConfigDefault]``. If the ID is unknown, ``find_path`` uses the
    default planner, as MoveIt does. The OMPL wheel does not contain EST.
    """
    own = planner_id.rpartition("[")[2].removesuffix("]")
    stem = own.rpartition("::")[2].removesuffix("kConfigDefault").lower()
    stem = {"": DEFAULT, "kpiece1": "kpiece", "bkpiece1": "bkpiece", "lbkpiece1": "lbkpiece"}.get(stem, stem)
    return stem if stem == PRM or stem in PLANNERS else None


def find_path(arm: ArmModel, collisions: Collisions, request: PathRequest, remaining_s: Remaining) -> FloatArray:
    """Search for a path from the start to one of the goals.

    The same request with the same scene always produces the same path if there is enough time. RRTstar improves its
    path until it has checked ``IMPROVING_EDGES`` edges, or until no time is left.

    Args:
        arm: The arm.
        collisions: Checks of the arm in the scene.
        request: Start, goals, margins, planner and seed.
        remaining_s: Function that returns the remaining time, in seconds.

    Returns:
        Points of the path (m, n), in rad or m. Every edge between them is free.

    Raises:
        PlanningError: The start or the goals are invalid, or no path was found in time.
    """
    return path_of_checked(arm, collisions, reduced(collisions, checked(arm, collisions, request)), remaining_s)


def path_of_checked(arm: ArmModel, collisions: Collisions, request: PathRequest, remaining_s: Remaining) -> FloatArray:
    """Search like ``find_path``, for a request that has already been checked."""
    stem = planner_stem(request.planner_id) or DEFAULT
    for goal in request.goals:
        if collisions.edge_contact(request.start, goal, request.margins) is None:
            return np.array([request.start, goal])
    for attempt in _attempts(stem, request.seed):
        if remaining_s() <= 0.0:
            break
        if (path := _run(arm, collisions, request, attempt, remaining_s)) is not None:
            return path
    raise PlanningError(
        "TIMED_OUT", f"{stem} found no path within the planning time: allow more time, or move the obstacles apart"
    )


def _attempts(stem: str, seed: int) -> Iterator[Attempt]:
    """Yield an endless series of attempts. Every second attempt uses a planner that performs better in narrow
    passages."""
    for number in count():
        planner = stem if number % 2 == 0 else NARROW if stem == DEFAULT else DEFAULT
        edges = EDGES * GROWTH**number * (NARROW_FACTOR if planner == NARROW else 1)
        most = IMPROVING_EDGES if planner == "rrtstar" else int(edges)
        yield Attempt(planner, RANGES_RAD[number // 2 % 3], most, (seed * 1009 + number) % (2**31 - 1) + 1)


class _Edges(base.MotionValidator):  # type: ignore[misc] # OMPL has no types
    """Checker for OMPL's edges. The checker must not keep references to OMPL's objects."""

    def __init__(self, space: Any, collisions: Collisions, joints: int, margins: Margins) -> None:
        super().__init__(space)
        self.checked = 0
        self._collisions, self._joints, self._margins = collisions, range(joints), margins

    def checkMotion(self, one: Any, other: Any) -> bool:
        self.checked += 1
        start, end = (np.array([state[i] for i in self._joints]) for state in (one, other))
        return self._collisions.edge_contact(start, end, self._margins) is None


def _run(
    arm: ArmModel, collisions: Collisions, request: PathRequest, attempt: Attempt, remaining_s: Remaining
) -> FloatArray | None:
    if attempt.planner == PRM:
        return roadmap_path(collisions, request, bounds(arm, request), attempt.seed, remaining_s)
    util.noOutputHandler()
    util.RNG.setSeed(attempt.seed)
    joints = range(len(arm.joints))
    space = base.RealVectorStateSpace(len(joints))
    ends = base.RealVectorBounds(len(joints))
    for i, lower, upper in zip(joints, *bounds(arm, request), strict=True):
        ends.setLow(i, float(lower))
        ends.setHigh(i, float(upper))
    space.setBounds(ends)
    padding_m = request.margins.padding_m
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(
        lambda state: collisions.is_clear(np.array([state[i] for i in joints]), padding_m)
    )
    edges = _Edges(information, collisions, len(joints), request.margins)
    information.setMotionValidator(edges)
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.addStartState(_state(space, request.start))
    target = base.GoalStates(information)
    for goal in request.goals:
        target.addState(_state(space, goal))
    problem.setGoal(target)
    planner = PLANNERS[attempt.planner](information)
    if hasattr(planner, "setRange"):
        planner.setRange(attempt.range_rad)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(_condition(edges, attempt, remaining_s))
    if not problem.hasExactSolution():
        return None
    return np.array([[state[i] for i in joints] for state in problem.getSolutionPath().getStates()])


def _condition(edges: _Edges, attempt: Attempt, remaining_s: Remaining) -> Any:
    def ends() -> bool:
        return edges.checked >= attempt.edges or remaining_s() <= 0.0

    return base.PlannerTerminationCondition(ends)


def _state(space: Any, positions: FloatArray) -> Any:
    state = space.allocState()
    for i, position in enumerate(positions):
        state[i] = float(position)
    return state
