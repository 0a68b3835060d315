"""Invariants on the path to a goal: commands pass through the client's points at the specified times."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from controller.action_goals import GoalStatus
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import Tracking
from hal.types import FloatArray, JointLimits, JointState
from servoloop.campaign.invariants.goals.ends import at_most_s
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.goal_log import LoggedGoal

PASSES: Final = 0.04
"""Maximum distance at which a sampled reference counts as passing through a point, in rad or m.

Paths cut corners by a few thousandths of a radian or meter, and a late cycle may skip a sample.
"""
JOINED_S: Final = 0.3
"""Time after which a path that starts in motion must pass through the client's points, in seconds."""
EARLY_CYCLES: Final = 2.0
"""Number of cycles by which a goal may end before its last point's time, because its start is rounded to a cycle."""
ENDS_EARLY_CYCLES: Final = 4
"""Number of cycles by which a reference may reach the last point early, because a path slows down before its end."""
TURNS: Final = 0.02
"""Minimum speed of a joint that moves or turns back, as a fraction of its velocity limit."""
STANDS: Final = 0.01
"""Maximum speed of a reference at rest, in rad/s or m/s."""
GAINS_S: Final = 0.1
"""Time for which a reference that accelerates may gain speed before it turns, in seconds."""
DETOUR: Final = 0.03
"""Maximum distance by which a path leaves the range between its start and its only point, in rad or m."""
SLOW_S: Final = 0.5
"""Time by which a path may exceed its expected duration, in seconds. After a pause, the reference rejoins the path
within 0.3 s."""
AT_POINT: Final = 1e-4
"""Maximum distance at which a reference counts as at rest at a point, in rad or m."""
STEADY: Final = 0.2
"""Maximum acceleration of a path on which a stop is examined, as a fraction of the acceleration limit. The remaining
fraction is enough to brake."""
CURVE_S: Final = 0.01
"""Time between two samples of a path, in seconds."""
OFF_CURVE: Final = 0.0005
"""Maximum distance of a stopping reference from its sampled path, in rad or m."""
BEGUN_CYCLES: Final = 3
"""Number of cycles after which a path certainly belongs to the newest goal."""
REPLACED_CYCLES: Final = 2
"""Maximum number of cycles until a replaced goal ends."""


@dataclass(slots=True)
class _Path:
    """Path of one goal."""

    begun_s: float
    speeds: FloatArray
    """Reference speeds (n,) just before the path began."""
    references: list[FloatArray] = field(default_factory=list)
    """Reference positions (n,) in each cycle."""
    begun_with: FloatArray | None = None
    """Reference velocities (n,) in the cycle in which the path began."""
    followed: int = 0
    """Number of cycles before the arm left the path."""


class PathIsAsSent(Invariant):
    """The path of a successful goal passes through all points of the client, and no path ends before the time of its
    last point.

    A path takes no longer than the client requested or the limits require. The path to a single point makes no detour.
    """

    name = "path is as sent"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._paths: dict[int, _Path] = {}
        """Path of each unfinished goal."""
        self._speed = self._at_rest = np.zeros(len(arm.joints))
        """Reference speeds in the previous cycle, including the speed that the acceleration may still add."""
        limits = dict(zip(self.commanded, stack.loop.limits, strict=True))
        self._bounded = {joint for joint in arm.joints if np.isfinite(limits[joint].upper - limits[joint].lower)}
        self._limits = limits

    def on_state(self, state: JointState) -> None:
        arm, tracking = self.arm, self.arm.tracking
        if tracking is not None and tracking.stamp_s == state.stamp_s:
            for logged in (*self.stack.goals.open, *self.stack.ended_goals):
                if logged.controller == arm.name and (tracking.on_goal or id(logged) in self._paths):
                    begun = _Path(state.stamp_s - tracking.elapsed_s, self._speed)
                    path = self._paths.setdefault(id(logged), begun)
                    path.references.append(tracking.reference.position)
                    path.followed += tracking.on_goal and path.followed + 1 == len(path.references)
                    if path.followed == len(path.references) and logged is self.newest_goal:
                        self._examine_omitted(logged, path, tracking.reference.velocity)
                    if tracking.on_goal and len(path.references) == BEGUN_CYCLES and logged is self.newest_goal:
                        self._examine_duration(logged, path, tracking.path.duration_s)
                    self._examine_end(logged, path.references)
        for logged in self.stack.ended_goals:
            ended = self._paths.pop(id(logged), None)
            if ended is not None and len(logged.goal.points) == 1 and ended.followed > 1:
                self._examine_way(logged, ended)
            if logged.controller == arm.name and logged.handle.status is GoalStatus.SUCCEEDED:
                self.examined += 1
                self._examine_success(logged, ended)
        self._speed = self._at_rest
        if tracking is not None:
            self._speed = np.abs(tracking.reference.velocity) + GAINS_S * np.abs(tracking.reference.acceleration)

    def _examine_success(self, logged: LoggedGoal, path: _Path | None) -> None:
        if path is None:
            self.say(f"a goal sent at {logged.sent_s:.2f} s succeeded, but its path never began")
            return
        self._examine(logged, np.array(path.references), path.begun_s)

    def _examine_omitted(self, logged: LoggedGoal, path: _Path, velocity: FloatArray) -> None:
        """Check that joints that the goal omits come to rest without turning back."""
        if path.begun_with is None:
            path.begun_with = velocity
        for place, joint in enumerate(self.arm.joints):
            moves = TURNS * self._limits[joint].velocity
            if joint in logged.goal.joints or abs(before := float(path.begun_with[place])) < moves:
                continue
            if velocity[place] * before < 0.0 and abs(velocity[place]) > moves:
                self.say(f"{joint} turns back to {velocity[place]:+.3f} rad/s, although the goal omits it")

    def _examine_end(self, logged: LoggedGoal, path: list[FloatArray]) -> None:
        """Check that an unfinished goal with one point does not come to rest at this point before the scheduled
        time."""
        goal = logged.goal
        early_s = logged.sent_s + goal.delay_s + goal.points[-1].time_from_start_s - self.stack.clock.now()
        if len(goal.points) > 1 or early_s <= ENDS_EARLY_CYCLES * self.stack.loop.period_s or len(path) < 2:
            return
        self.examined += 1
        columns = [self.arm.joints.index(joint) for joint in goal.joints]
        point = np.array(goal.points[0].positions)
        begin, before, now = (np.abs(one[columns] - point).max() for one in (path[0], *path[-2:]))
        if begin > PASSES and max(before, now) < AT_POINT:
            self.say(f"the path of a goal sent at {logged.sent_s:.2f} s ends {early_s:.2f} s before the goal's time")

    def _examine(self, logged: LoggedGoal, path: FloatArray, begun_s: float) -> None:
        goal, period_s = logged.goal, self.stack.loop.period_s
        # A goal with a stamp begins at this time. Any other goal may first wait for other controllers.
        start_s = logged.sent_s + goal.delay_s if goal.delay_s else begun_s
        early_s = start_s + goal.points[-1].time_from_start_s - self.stack.clock.now()
        if early_s > EARLY_CYCLES * period_s:
            self.say(
                f"a goal sent at {logged.sent_s:.2f} s succeeded {early_s:.2f} s before the time of its last point"
            )
        joints = [joint for joint in goal.joints if joint in self._bounded]
        columns = [self.arm.joints.index(joint) for joint in joints]
        places = [goal.joints.index(joint) for joint in joints]
        path, before = path[:, columns], 0
        for number, point in enumerate(goal.points):
            if start_s + point.time_from_start_s < begun_s + JOINED_S and number < len(goal.points) - 1:
                continue
            ends = [self.end_of_goal(joint, point.positions[i]) for joint, i in zip(joints, places, strict=True)]
            off = _distances(path[before:], np.array(ends))
            if off.min() > PASSES:
                text = f"by {off.min():.3f}"
                self.say(f"a goal sent at {logged.sent_s:.2f} s succeeded, but its path misses point #{number} {text}")
                return
            before += int(np.flatnonzero(off <= PASSES)[0])

    def _examine_way(self, logged: LoggedGoal, path: _Path) -> None:
        """Check that a path to one point stays between its start and the point.

        A path that starts in motion first brakes, so it may leave this range.
        """
        goal, references = logged.goal, np.array(path.references[: path.followed])
        wanted = dict(zip(goal.joints, goal.points[0].positions, strict=True))
        for place, joint in enumerate(self.arm.joints):
            if joint not in self._bounded:
                continue
            limit, way = self._limits[joint], references[:, place]
            slack = DETOUR + limit.acceleration * _brakes_s(path.speeds[place], limit) ** 2
            end = self.end_of_goal(joint, wanted.get(joint, way[0]))  # a joint that the goal omits stays
            if not min(way[0], end) - slack <= way.min() <= way.max() <= max(way[0], end) + slack:
                off = f"from {way.min():.3f} to {way.max():.3f}"
                self.say(f"a goal sent {joint} from {way[0]:.3f} to {end:.3f}, but its path extends {off}")

    def _examine_duration(self, logged: LoggedGoal, path: _Path, duration_s: float) -> None:
        """Check that a path is not too slow. In the slowest allowed case, the joints first brake and then stop at each
        point."""
        self.examined += 1
        goal, here = logged.goal, dict(zip(self.arm.joints, path.references[0].tolist(), strict=True))
        limits = [self._limits[joint] for joint in self.arm.joints]
        needs_s = 2.0 * max(_brakes_s(speed, limit) for speed, limit in zip(path.speeds, limits, strict=True))
        for point in goal.points:
            there = dict(zip(goal.joints, point.positions, strict=True))
            ends = {joint: self.end_of_goal(joint, end) for joint, end in there.items()}
            needs_s += max(at_most_s(abs(end - here[joint]), self._limits[joint]) for joint, end in ends.items())
            here |= ends
        asked_s = goal.delay_s + goal.points[-1].time_from_start_s
        if duration_s > max(asked_s, needs_s) + SLOW_S:
            asked = f"{asked_s:.2f} s, and the limits require only {needs_s:.2f} s"
            self.say(f"the path of a goal takes {duration_s:.2f} s, but its client requested {asked}")


def _brakes_s(speed: float, limit: JointLimits) -> float:
    """Return the time (s) in which a joint comes to rest."""
    return speed / limit.acceleration + 2.0 * limit.acceleration / limit.jerk if speed > STANDS else 0.0


def _distances(path: FloatArray, point: FloatArray) -> FloatArray:
    """Return the largest joint distance between a point (n,) and each segment of a path (m, n)."""
    starts, ways = path[:-1], np.diff(path, axis=0)
    if not len(ways):
        starts, ways = path, np.zeros_like(path)
    lengths = np.maximum((ways**2).sum(axis=1), 1e-12)
    share = np.clip(((point - starts) * ways).sum(axis=1) / lengths, 0.0, 1.0)
    distances: FloatArray = np.abs(starts + share[:, None] * ways - point).max(axis=1)
    return distances


class StopsFollowPaths(Invariant):
    """If a goal ends early, the arm brakes along the goal's path: the reference stays on the path until it is at rest.

    A stop is not examined if the path accelerates or ends during the time needed to brake, because the limits may not
    allow braking along such a path. A stop that is caused by another goal is not examined either. The same applies to a
    stop in which no joint is measured and the arm comes to rest at its last command.
    """

    name = "stops follow paths"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        limits = [stack.loop.limits[self.commanded.index(joint)] for joint in arm.joints]
        self._acceleration = np.array([limit.acceleration for limit in limits])
        self._jerk = np.array([limit.jerk for limit in limits])
        self._before: Tracking | None = None
        self._curve: FloatArray | None = None
        """Rest of the path (m, n) when the examined stop began."""

    def on_state(self, state: JointState) -> None:
        before, now = self._before, self.arm.tracking
        self._before = now
        silent = state.faults.keys() >= set(self.arm.joints)
        if now is None or now.on_goal or silent or not self.arm.parameters.constraints.decelerate_on_cancel:
            self._curve = None
        elif before is not None and before.on_goal:
            self._curve = None if now.path is before.path or self._replaced(state) else self._rest_of(before)
        elif before is None or before.path is not now.path or now.elapsed_s > now.path.duration_s:
            self._curve = None
        if now is None or self._curve is None:
            return
        self.examined += 1
        off = float(_distances(self._curve, now.reference.position).min())
        if off > OFF_CURVE:
            self.say(f"the arm brakes {off:.4f} away from its path")

    def _replaced(self, state: JointState) -> bool:
        """Return whether a client has just sent another goal, along whose path the arm may brake."""
        sent_s = [logged.sent_s for logged in self.stack.goals.goals if logged.controller == self.arm.name]
        return bool(sent_s) and state.stamp_s - sent_s[-1] < REPLACED_CYCLES * self.stack.loop.period_s

    def _rest_of(self, before: Tracking) -> FloatArray | None:
        """Return the rest of a path, or None if the limits may not allow a stop along this path."""
        path, from_s = before.path, before.elapsed_s
        speed = np.abs(path.sample(from_s).velocity)
        brakes_s = float((speed / self._acceleration + 2.0 * self._acceleration / self._jerk).max())
        if before.rate != 1.0 or from_s + brakes_s > path.duration_s:
            return None
        samples = [path.sample(time_s) for time_s in np.arange(from_s, from_s + brakes_s, CURVE_S)]
        steady = all((np.abs(sample.acceleration) <= STEADY * self._acceleration).all() for sample in samples)
        rest_s = np.arange(from_s, path.duration_s + CURVE_S, CURVE_S)
        return np.array([path.sample(time_s).position for time_s in rest_s]) if steady else None


class ReplacedGoalsEnd(Invariant):
    """A goal ends when its controller accepts another goal.

    A controller does not accept a goal while its joints are still slowing down from the motion of another controller.
    """

    name = "replaced goals end"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._cycles = 0

    def on_state(self, state: JointState) -> None:
        newest = self.newest_goal
        goals = [one for one in self.stack.goals.open if one.controller == self.arm.name and one is not newest]
        ended = [one for one in self.stack.ended_goals if one.controller == self.arm.name and one is not newest]
        self.examined += bool(goals or ended)
        manager = self.stack.manager
        takes = manager.cycle.at_rest(manager.registry.loaded[self.arm.name].index)
        self._cycles = self._cycles + 1 if goals and takes else 0
        if self._cycles > REPLACED_CYCLES:
            self.say(f"a goal of {self.arm.name} continues, although a newer goal was accepted")
