"""Planning for one group of joints: free motions, straight motions and inverse kinematics."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any, Final

import numpy as np

from hal.types import FloatArray, JointLimits, far_outside
from planning.arm_model import ArmModel
from planning.collision import CONTACT_M, MARGINS, Clearance, Collisions, Margins
from planning.constraints import ConstrainedCollisions, PathConstraints, Region
from planning.group_goals import GroupGoals
from planning.groups import Group
from planning.kinematics.cartesian import Checks, tool_path
from planning.kinematics.chain import Chain, moved_by
from planning.motion import (
    FutureContact,
    LineMotion,
    LineRequest,
    Motion,
    MotionRequest,
    State,
    ToolGoal,
    positions_of,
    with_positions,
)
from planning.paths.margins import PathMargins
from planning.paths.planner import plan_path
from planning.paths.request import PathRequest, Remaining
from planning.paths.smooth_timing import timed_smoothly
from planning.paths.thinning import thinned
from planning.paths.timing import TimedPath, scaled, timed
from planning.planning_errors import PlanningError
from planning.scene import Pose, Scene

THINNING_M: Final = 2e-4
"""Maximum deviation of the timed motion from a straight path, measured as motion of any geometry, in m."""
ROUNDING_M: Final = 1e-6
"""Maximum distance at which a point is considered to be on a straight edge. The distance is measured as the motion of
any geometry, in m.
"""
SLOWER: Final = 1.5
"""Maximum factor by which a spline may be slower than blends and still be used. A spline follows the line of a straight
motion more closely.
"""
NEAR: Final = PathMargins(Margins(1e-3, 5e-4))
"""Margins below which a motion in progress is considered to be in contact."""


class GroupPlanner:
    """Planner for one group.

    The planner never changes, and each call uses its own data. OMPL's random number generator is global in a process,
    so only one thread at a time may run ``plan``.

    Args:
        model: Compiled scene (mujoco.MjModel).
        limits: Limits of all driven joints, keyed by name.
        group: The group. All joints of the group must be in ``limits``.
    """

    def __init__(self, model: Any, limits: Mapping[str, JointLimits], group: Group) -> None:
        self.group = group
        self.joints = group.joints
        """Names of the joints (n), in the order used by all arrays."""
        self.limits = {joint: limits[joint] for joint in group.joints}
        """Joint limits, keyed by name."""
        self._model: Any = model
        self._others = tuple(joint for joint in limits if joint not in self.limits)

    def plan(self, request: MotionRequest) -> Motion:
        """Plan a motion without contacts, within the velocity, acceleration and jerk limits.

        Raises:
            PlanningError: The start or all goals are invalid, or no motion was found in time.
        """
        return self._within(request.constraints, request.start)._plan(request)

    def _plan(self, request: MotionRequest) -> Motion:
        begun_s = request.remaining_s()
        limits = scaled(tuple(self.limits.values()), request.scaling.velocity, request.scaling.acceleration)
        arm = self._arm(request.start)
        start = self._inside(request.start)
        collisions = self._collisions(arm, request.scene, request.constraints, request.start)
        solver = self._goals(request.start, request.seed, request.remaining_s)
        goals = solver.positions(request.goals, start, collisions, request.margins)
        goals = _kept(goals, collisions)
        asked = PathRequest(start, tuple(goals), request.planner_id, request.margins, request.seed)
        plan = plan_path(arm, collisions, asked, request.remaining_s, request.searches)
        found_s = request.remaining_s()
        path = timed(plan.points, limits, collisions, plan.margins)
        end = with_positions(request.start, self.joints, path.positions[-1])
        times_s = begun_s - found_s, found_s - request.remaining_s()
        return Motion(self.joints, path, end, plan.margins.for_parts(), *times_s)

    def straight(self, request: LineRequest) -> LineMotion:
        """Move a link straight from waypoint to waypoint, as far as possible.

        Raises:
            PlanningError: A waypoint or the start is invalid, or the link does not exist.
        """
        return self._within(request.constraints, request.start)._straight(request)

    def _straight(self, request: LineRequest) -> LineMotion:
        limits = scaled(tuple(self.limits.values()), request.scaling.velocity, request.scaling.acceleration)
        arm, chain = self._arm(request.start), self.chain(request.link, request.start, request.offset)
        scene = request.scene if request.avoid_collisions else Scene(allowed=arm.everything())
        start = self._inside(request.start)
        collisions = self._collisions(arm, scene, request.constraints, request.start)
        own = self._indices(chain)

        def whole(positions: FloatArray) -> FloatArray:
            full = start.copy()
            full[own] = positions
            return full

        margins = request.margins.within(max(collisions.room_m(start, request.margins.padding_m), CONTACT_M))
        checks = Checks(
            lambda one: _text(collisions.contact(whole(one), margins.padding_m)),
            lambda one, other: _text(collisions.edge_contact(whole(one), whole(other), margins)),
        )
        found = tool_path(chain, start[own], request.waypoints, request.steps, checks)
        if len(found.positions) < 2:
            return LineMotion(None, found.fraction, found.reason)
        points = thinned(np.array([whole(one) for one in found.positions]), collisions.levers_m, THINNING_M)
        path = timed(points, limits, collisions, margins)
        smooth = timed_smoothly(points, limits, collisions, margins)
        if smooth is not None and smooth.duration_s < SLOWER * path.duration_s:
            path = smooth
        end = with_positions(request.start, self.joints, path.positions[-1])
        motion = Motion(self.joints, path, end, PathMargins(margins).for_parts())
        return LineMotion(motion, found.fraction, found.reason)

    def inverse(
        self,
        goal: ToolGoal,
        state: State,
        scene: Scene | None = None,
        margins: Margins = MARGINS,
        accepts: Callable[[State], bool] | None = None,
    ) -> State:
        """Return a state in which a link is at a pose, near the given state if possible.

        Args:
            goal: Link, and region of poses.
            state: Positions of all driven joints. Joints of other groups keep these positions.
            scene: Scene in which the state must be free of contacts. If None, contacts are ignored.
            margins: Clearances that the state keeps if possible.
            accepts: Function that returns whether a state that reaches the pose is allowed. By default, every state is
                allowed.

        Raises:
            UnreachableError: The pose cannot be reached. The error contains the nearest reachable pose.
            CollidingError: The pose can be reached only with contacts or in states that are not accepted.
            PlanningError: The link does not exist.
        """
        checks = None if scene is None else (Collisions(self._arm(state), scene), margins)
        chain = self.chain(goal.link, state, goal.offset)
        goals = self._goals(state, seed=1)

        def kept(positions: FloatArray) -> bool:
            return accepts is None or accepts(with_positions(state, self.joints, positions))

        found = goals.of_pose(chain, goal.goal, self._inside(state), checks, kept)
        return with_positions(state, self.joints, found[0])

    def narrowed(self, constraints: PathConstraints) -> "GroupPlanner":
        """Return a planner whose limits are narrowed to the joint ranges in the constraints.

        Raises:
            PlanningError: A range does not overlap the limits.
        """
        planner = copy(self)
        planner.limits = constraints.limits(self.limits)
        return planner

    def clearance(self, state: State, scene: Scene) -> Clearance:
        """Return the smallest distance between the links that the group moves and the robot itself or any object."""
        return Collisions(self._arm(state), scene).clearance(np.array(positions_of(state, self.joints)))

    def future_contact(
        self, path: TimedPath, from_s: float, state: State, scene: Scene, margins: PathMargins = NEAR
    ) -> FutureContact | None:
        """Return the first contact in the remainder of a motion of this group, or None.

        Args:
            path: Timed path of the motion.
            from_s: Time at which the check begins, in seconds since the start of the motion.
            state: Positions of all driven joints, used for joints of other groups.
            scene: The current scene.
            margins: Distances below which links and objects are considered in contact.
        """
        collisions = Collisions(self._arm(state), scene)
        times_s, points = path.since(from_s)
        if margins.contact(collisions, list(thinned(points, collisions.levers_m, ROUNDING_M))) is None:
            return None
        contact = margins.contact(collisions, list(points))
        if contact is None:
            return None
        index = min(int(contact.part), len(times_s) - 2)
        at_s = times_s[index] + (contact.part - index) * (times_s[index + 1] - times_s[index])
        return FutureContact(float(at_s), *contact.pair)

    def chain(self, link: str | None, state: State, offset: Pose | None = None) -> Chain:
        """Return the kinematics of a link or site, in the robot's frame, with the joints of the group that move it.

        Args:
            link: Link or site, or the tip of the group if None.
            state: Positions of all driven joints. Only the positions of joints that do not move the link are used.
            offset: Frame to use instead of the link's frame. The frame is fixed to the link and given relative to it.

        Raises:
            PlanningError: The link does not exist, or the group does not move it.
        """
        name = link or self.group.tip
        if name is None:
            raise PlanningError("INVALID_LINK_NAME", f"the group {self.group.name} has no tip: specify a link")
        moving = moved_by(self._model, tuple(self.joints), name)
        if not moving:
            raise PlanningError(
                "INVALID_LINK_NAME", f"no joint of the group {self.group.name} moves {name}: choose another link"
            )
        arm = self._arm(state)
        arm.set(np.array(positions_of(state, self.joints)))
        others = {joint: at for joint, at in state.items() if joint not in moving} | arm.follower_positions()
        chain = Chain(self._model, {joint: self.limits[joint] for joint in moving}, name, others=others)
        return chain if offset is None else chain.at_frame(offset.matrix, offset.position_m)

    def _indices(self, chain: Chain) -> list[int]:
        return [self.joints.index(name) for name in chain.names]

    def _within(self, constraints: PathConstraints, start: State) -> "GroupPlanner":
        """Return a planner whose limits are narrowed to the path constraints. Raises PlanningError if the start
        violates a joint range, or a range does not overlap the limits."""
        if not constraints.joints:
            return self
        if text := constraints.broken_range(start):
            raise PlanningError(
                "START_STATE_VIOLATES_PATH_CONSTRAINTS", f"start: {text}: move the joint into its range first"
            )
        return self.narrowed(constraints)

    def _collisions(self, arm: ArmModel, scene: Scene, constraints: PathConstraints, start: State) -> Collisions:
        """Return the collision checks for a request. Raises PlanningError if the start violates a constraint."""
        if not constraints.regions:
            return Collisions(arm, scene)
        collisions = ConstrainedCollisions(arm, scene, self._regions(constraints, start))
        if text := collisions.broken_region(self._inside(start)):
            raise PlanningError(
                "START_STATE_VIOLATES_PATH_CONSTRAINTS", f"start: {text}: move the link into its region first"
            )
        return collisions

    def _regions(self, constraints: PathConstraints, state: State) -> list[Region]:
        regions = []
        for region in constraints.regions:
            chain = self.chain(region.link, state, region.offset)
            regions.append(Region(chain, region.goal, self._indices(chain)))
        return regions

    def _arm(self, state: State) -> ArmModel:
        arm = ArmModel(self._model, self.limits)
        arm.set_others({joint: state[joint] for joint in self._others})
        return arm

    def _goals(self, state: State, seed: int, remaining_s: Remaining | None = None) -> GroupGoals:
        lower = np.array([limit.lower for limit in self.limits.values()])
        upper = np.array([limit.upper for limit in self.limits.values()])
        return GroupGoals(
            self.joints, (lower, upper), lambda link, offset: self.chain(link, state, offset), seed, remaining_s
        )

    def _inside(self, state: State) -> FloatArray:
        """Return positions in joint order (n,). A joint slightly outside its limits is considered to be at its
        limit."""
        return np.array(
            [
                at if far_outside(at, limit) else min(max(at, limit.lower), limit.upper)
                for at, limit in zip(positions_of(state, self.joints), self.limits.values(), strict=True)
            ]
        )


def _kept(goals: Sequence[FloatArray], collisions: Collisions) -> list[FloatArray]:
    """Return the goals (n,) that satisfy the constraints. Raises PlanningError if none of the goals does."""
    if not isinstance(collisions, ConstrainedCollisions):
        return list(goals)
    texts = [collisions.broken_region(goal) for goal in goals]
    kept = [goal for goal, text in zip(goals, texts, strict=True) if not text]
    if not kept:
        raise PlanningError(
            "GOAL_VIOLATES_PATH_CONSTRAINTS", f"goal: {texts[0]}: move the goal, or widen the constraint"
        )
    return kept


def _text(contact: tuple[float, tuple[str, str]] | None) -> str:
    return "" if contact is None else f"{contact[1][0]} comes too close to {contact[1][1]}"
