"""Compute straight tool paths, like MoveIt's compute_cartesian_path."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from hal.rotations import angle_between, slerp
from hal.types import FloatArray
from planning.kinematics.chain import Chain, ToolPose
from planning.kinematics.descent import DescentEffort, descend
from planning.kinematics.goals import FARTHEST_M, INSIDE, PoseGoal, PositionSphere, checked_pose, invalid

TURN_PER_METER: Final = 3.5
"""Maximum rotation of the tool in one step, in rad per meter of the maximum step length. MoveIt uses the same value."""
MOST_STEPS: Final = 20_000
"""Maximum number of steps in a path."""
EFFORT: Final = DescentEffort(steps=40, enough=1)
"""Effort limits for the search for the next point, which starts at the previous point."""
AT_LIMIT: Final = 1e-6
"""Maximum distance from a limit at which a joint is considered to be at the limit, in rad or m."""

Problem = Callable[[FloatArray], str]
"""Function that describes why joint positions (n,) are not valid, such as "link3 touches box", or returns ""."""
EdgeProblem = Callable[[FloatArray, FloatArray], str]
"""Function that describes why the straight motion between two joint positions (n,) is not valid, or returns ""."""


@dataclass(frozen=True, slots=True)
class Steps:
    """Step sizes of a path, and limits for joint jumps. The path ends before a jump that exceeds a limit."""

    longest_m: float = 0.01
    """Maximum motion of the tool between two points, in m."""
    jump_rad: float = 0.5
    """Maximum motion of a revolute joint between two points, in rad, or 0 for no limit."""
    jump_m: float = 0.05
    """Maximum motion of a prismatic joint between two points, in m, or 0 for no limit."""
    jump_factor: float = 0.0
    """Maximum motion of the joints between two points, as a multiple of the mean motion, or 0 for no limit."""
    deviation_m: float = 5e-4
    """Maximum distance of a point from the line, in m."""
    deviation_rad: tuple[float, float, float] = (0.01, 0.01, 0.01)
    """Maximum rotation about each tool axis from the interpolated orientation, in rad. If a value is pi or more, the
    rotation about that axis is not limited.
    """

    def __post_init__(self) -> None:
        """Check the values. Raises GoalError."""
        if not math.isfinite(self.longest_m) or self.longest_m <= 0.0:
            raise invalid(f"the maximum step is {self.longest_m:g} m: send a finite number above 0")
        for name in ("jump_rad", "jump_m", "jump_factor"):
            if not getattr(self, name) >= 0.0:
                raise invalid(f"{name} is {getattr(self, name):g}: send 0 for no limit, or a number above 0")


@dataclass(frozen=True, slots=True)
class Checks:
    """Checks of a path, such as collision checks. By default, every path is valid."""

    at: Problem = lambda _: ""
    between: EdgeProblem = lambda _, __: ""


@dataclass(frozen=True, slots=True, eq=False)
class ToolPath:
    """Straight path of the tool."""

    positions: FloatArray
    """Joint positions (m, n), in rad or m, beginning with the start positions."""
    fraction: float
    """Fraction of the path that was completed, from 0 to 1."""
    reason: str = ""
    """Reason why the path ends early, or empty if the path is complete."""


def tool_path(
    chain: Chain, start: FloatArray, waypoints: Sequence[ToolPose], steps: Steps, checks: Checks | None = None
) -> ToolPath:
    """Move the tool straight from one pose to the next. Between two poses, the orientation changes at a constant rate.

    Args:
        chain: Kinematics of the arm.
        start: Joint positions at the start (n,), in rad or m.
        waypoints: Tool poses after the start.
        steps: Step lengths and jump limits.
        checks: Checks of each point and of the motion to that point.

    Returns:
        The path up to the first point that cannot be reached, and the reason why it ends there.

    Raises:
        GoalError: A waypoint is invalid, the tool is too far away from the base, or the path has too many steps.
        PlanningError: The start is invalid.
    """
    start, checks = chain.checked(start), checks or Checks()
    begin = chain.pose(start)
    if not np.abs(begin.position_m).max() <= FARTHEST_M:
        raise invalid(
            f"the tool is more than {FARTHEST_M:g} m away from the base: check the pose of the object attached to "
            f"{chain.tool}"
        )
    if text := checks.at(start):
        return ToolPath(start[None], 0.0, text)
    found, shares, reason = [start], [0.0], ""
    for pose, share in _points(begin, waypoints, steps):
        following = _follow(chain, pose, found[-1], steps)
        reason = (
            _miss(chain, pose, following, steps)
            or _jump(chain, found[-1], following, steps)
            or checks.at(following)
            or checks.between(found[-1], following)
        )
        if reason:
            break
        found.append(following)
        shares.append(share)
    return _without_relative_jump(ToolPath(np.array(found), shares[-1], reason), shares, steps.jump_factor)


def _points(start: ToolPose, waypoints: Sequence[ToolPose], steps: Steps) -> Iterator[tuple[ToolPose, float]]:
    """Yield the points of the path, each with the fraction of the path completed so far. Raises GoalError if there are
    no waypoints, a waypoint is invalid, or the path has too many steps."""
    if not waypoints:
        raise invalid("the path has no waypoints: send at least one pose")
    poses = [start, *(checked_pose(pose.position_m, pose.quaternion_xyzw) for pose in waypoints)]
    counts = [_count(one, other, steps.longest_m) for one, other in pairwise(poses)]
    if sum(counts) > MOST_STEPS:
        raise invalid(f"the path has {sum(counts):.6g} steps, above {MOST_STEPS}: send a larger maximum step")
    for number, (one, other) in enumerate(pairwise(poses)):
        for step in range(1, int(counts[number]) + 1):
            share = step / counts[number]
            position = one.position_m + share * (other.position_m - one.position_m)
            between = ToolPose(position, slerp(one.quaternion_xyzw, other.quaternion_xyzw, share))
            yield between, (number + share) / len(waypoints)


def _count(one: ToolPose, other: ToolPose, longest_m: float) -> float:
    """Return the number of steps between two poses, which is infinite if it exceeds the range of a float."""
    distance_m = float(np.linalg.norm(other.position_m - one.position_m))
    angle_rad = angle_between(one.quaternion_xyzw, other.quaternion_xyzw)
    return max(1.0, float(np.ceil(max(distance_m, angle_rad / TURN_PER_METER) / longest_m - 1e-9)))


def _goal(pose: ToolPose, steps: Steps) -> PoseGoal:
    return PoseGoal(pose, PositionSphere(steps.deviation_m), steps.deviation_rad)


def _follow(chain: Chain, pose: ToolPose, previous: FloatArray, steps: Steps) -> FloatArray:
    """Return joint positions (n,) close to the previous positions, with the tool as close to the pose as possible."""
    goal = _goal(pose, steps)
    found = descend(chain, goal, previous[None], 0.0, EFFORT)
    if not goal.contains(chain.transforms(found.positions))[0]:
        found = descend(chain, goal, found.positions, INSIDE, EFFORT)
    return np.asarray(found.positions[0])


def _miss(chain: Chain, pose: ToolPose, positions: FloatArray, steps: Steps) -> str:
    """Describe why the tool does not reach the pose at these joint positions (n,), or return an empty string."""
    goal, tool = _goal(pose, steps), chain.transforms(positions[None])
    if goal.contains(tool)[0]:
        return ""
    ends = (("lower", chain.lower, positions - chain.lower), ("upper", chain.upper, chain.upper - positions))
    reached = [
        f"{name} reaches its {end} limit {limit:.4f}"
        for end, limits, room in ends
        for name, limit, distance in zip(chain.names, limits.tolist(), room.tolist(), strict=True)
        if distance <= AT_LIMIT
    ]
    if reached:
        return " and ".join(reached)
    distance_m, angle_rad = goal.distances(tool)[0].tolist()
    return f"the arm cannot follow the line: {chain.tool} stays {distance_m:.4f} m and {angle_rad:.3f} rad away from it"


def _jump(chain: Chain, before: FloatArray, after: FloatArray, steps: Steps) -> str:
    """Describe the first joint that jumps between two points (n,), or return an empty string."""
    for name, turns, moved in zip(chain.names, chain.turns.tolist(), np.abs(after - before).tolist(), strict=True):
        limit, unit = (steps.jump_rad, "rad") if turns else (steps.jump_m, "m")
        if limit and moved > limit:
            return f"{name} jumps by {moved:.3f} {unit} in one step of the tool, above {limit:g} {unit}"
    return ""


def _without_relative_jump(path: ToolPath, shares: Sequence[float], factor: float) -> ToolPath:
    """Truncate a path before the first step that is much longer than the mean step."""
    moved = np.abs(np.diff(path.positions, axis=0)).sum(axis=1)
    jumps = np.flatnonzero(moved > factor * moved.mean()) if factor and len(moved) else np.array([], dtype=int)
    if not len(jumps):
        return path
    end = int(jumps[0])
    multiple = moved[end] / moved.mean()
    reason = f"the joints jump by {multiple:.1f} times the mean step, but the jump threshold is {factor:g}"
    return ToolPath(path.positions[: end + 1], shares[end], reason)
