"""Plan to random tool poses: reachable poses must be planned and unreachable ones rejected, each within 1 s."""

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from planning.collision import Margins
from planning.group_planner import GroupPlanner
from planning.kinematics.chain import ToolPose
from planning.kinematics.goals import PoseGoal, PositionSphere
from planning.motion import Motion, MotionRequest, State, ToolGoal, with_positions
from planning.paths.margins import PathMargins
from planning.planning_errors import PlanningError
from planning.robot import PlanningRobot
from servoloop.motion_planning.robot import arm_group, planning_robot
from servoloop.stack.arm_folders import find_arm, read_arm_files

TOLERANCE_M: Final = 0.005
TOLERANCE_RAD: Final = 0.05
ENOUGH_S: Final = 1.0
"""Maximum time to plan or reject a pose, in s."""
TOUCHING: Final = PathMargins(Margins(1e-5, 1e-5))
"""Distance below which a plan counts as touching an object."""
LIMIT_S: Final = 5.0
"""Time limit of a request, in s."""
FARTHER: Final = (1.05, 2.0)
"""Distances of unreachable poses from the base, as multiples of the largest distance of any random pose."""


@dataclass(slots=True)
class PoseResults:
    """Results for one arm."""

    arm: str
    planned_s: list[float] = field(default_factory=list)
    failed: Counter[str] = field(default_factory=Counter)
    refused_s: list[float] = field(default_factory=list)
    wrong: int = 0
    """Number of plans that end outside the goal region, or that touch something on the way."""
    accepted: int = 0
    """Number of unreachable poses that were not rejected."""

    def lines(self) -> list[str]:
        """Return the results as a string."""
        planned, refused = np.array(self.planned_s) * 1e3, np.array(self.refused_s) * 1e3
        tried, quick = len(planned) + self.failed.total(), int((planned < ENOUGH_S * 1e3).sum())
        return [
            f"{self.arm}: {quick} of {tried} reachable poses planned in {ENOUGH_S} s, {100.0 * quick / tried:.1f} %",
            f"  median {np.median(planned):.0f} ms, 95th percentile {np.percentile(planned, 95):.0f} ms, longest "
            f"{planned.max():.0f} ms; not planned: {dict(self.failed) or 'none'}; wrong plans: {self.wrong}",
            f"  {int((refused < ENOUGH_S * 1e3).sum())} of {len(refused) + self.accepted} unreachable poses refused "
            f"within {ENOUGH_S} s, median {np.median(refused):.0f} ms, longest {refused.max():.0f} ms",
        ]


def run_poses(arm: str, reachable: int, unreachable: int, seed: int) -> PoseResults:
    """Plan to random poses of one arm, starting at its first named state or at its pose in the scene file."""
    files = read_arm_files(find_arm(arm))
    robot = planning_robot(files)
    group = robot.group(arm_group(robot, files).name)
    start = {**robot.rest, **group.group.states.get("ready", {})}
    results, random = PoseResults(arm), np.random.default_rng(seed)
    goals, farthest_m = _reachable(robot, group, start, random, reachable)
    for goal in goals:
        found, spent_s = _planned(robot, group, start, goal)
        if isinstance(found, PlanningError):
            results.failed[found.code] += 1
        else:
            results.planned_s.append(spent_s)
            results.wrong += not _is_right(robot, group, start, goal, found)
    for goal in _unreachable(farthest_m, random, unreachable):
        found, spent_s = _planned(robot, group, start, goal)
        if isinstance(found, PlanningError):
            results.refused_s.append(spent_s)
        else:
            results.accepted += 1
    return results


def _planned(
    robot: PlanningRobot, group: GroupPlanner, start: State, goal: PoseGoal
) -> tuple[Motion | PlanningError, float]:
    """Return the motion or the error, together with the elapsed time in s."""
    begun_s = time.perf_counter()
    request = MotionRequest(
        start=start,
        goals=(ToolGoal(goal),),
        scene=robot.scene,
        remaining_s=lambda: begun_s + LIMIT_S - time.perf_counter(),
    )
    try:
        motion = group.plan(request)
    except PlanningError as error:
        return error, time.perf_counter() - begun_s
    return motion, time.perf_counter() - begun_s


def _is_right(robot: PlanningRobot, group: GroupPlanner, start: State, goal: PoseGoal, motion: Motion) -> bool:
    """Return whether a motion ends in the goal region, according to MuJoCo's kinematics, and touches nothing."""
    if group.group.tip is None:
        return False
    end = robot.link_poses([group.group.tip], motion.end)[group.group.tip]
    tool = np.eye(4)
    tool[:3, :3], tool[:3, 3] = end.matrix, end.position_m
    clear = group.future_contact(motion.path, 0.0, start, robot.scene, TOUCHING) is None
    return clear and bool(goal.contains(tool[None])[0])


def _reachable(
    robot: PlanningRobot, group: GroupPlanner, start: State, random: np.random.Generator, count: int
) -> tuple[list[PoseGoal], float]:
    """Return regions around the tool poses at random joint positions without contact, and the largest distance of these
    poses, in m."""
    chain = group.chain(None, start)
    lower, upper = (np.array([getattr(limit, end) for limit in group.limits.values()]) for end in ("lower", "upper"))
    lower, upper = np.maximum(lower, -np.pi), np.minimum(upper, np.pi)
    goals: list[PoseGoal] = []
    farthest_m = 0.0
    while len(goals) < count:
        positions = random.uniform(lower, upper)
        pose = chain.pose(positions)
        farthest_m = max(farthest_m, float(np.linalg.norm(pose.position_m)))
        if group.clearance(with_positions(start, group.joints, positions), robot.scene).distance_m > 0.0:
            goals.append(PoseGoal(pose, PositionSphere(TOLERANCE_M), (TOLERANCE_RAD,) * 3))
    return goals, farthest_m


def _unreachable(farthest_m: float, random: np.random.Generator, count: int) -> Iterator[PoseGoal]:
    for _ in range(count):
        direction, quaternion = random.normal(size=3), random.normal(size=4)
        position_m = direction / np.linalg.norm(direction) * farthest_m * random.uniform(*FARTHER)
        pose = ToolPose(position_m, quaternion / np.linalg.norm(quaternion))
        yield PoseGoal(pose, PositionSphere(TOLERANCE_M), (TOLERANCE_RAD,) * 3)
