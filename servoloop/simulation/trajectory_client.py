"""Simulated client that sends trajectories to the controller of an arm, as planners and teleoperation programs do."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from controller.guided_motion import HORIZON_S, GuidedMotion, JointPositions
from controller.motion import Kinematics, motion_to
from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from controller.trajectory.tolerances import Tolerances
from hal.types import FloatArray, JointLimits, JointState
from servoloop.simulation.acts import Cancel, FollowPlan, FollowWaypoints, Jog, Move, Stream
from servoloop.simulation.stack import SimulatedStack

TABLE_S: Final = 0.1
"""Time between two points of a planner's trajectory, in seconds."""
AHEAD_S: Final = 0.2
"""``time_from_start`` of each streamed point, in seconds."""
JOG_SHARE: Final = 0.3
"""Maximum jogging velocity, as a fraction of the velocity limit."""


class TrajectoryClient:
    """Client of a trajectory controller.

    Args:
        stack: The stack.
        arm: The trajectory controller.
    """

    def __init__(self, stack: SimulatedStack, arm: Any) -> None:
        self._stack, self._arm = stack, arm
        self._measured: FloatArray = np.full(len(arm.joints), np.nan)
        """Measured positions (n,) of the arm's joints in the latest cycle, in rad or m."""

    def measured(self, state: JointState) -> None:
        """Keep the measured positions of a cycle. Call this in each cycle before an action."""
        joints = self._stack.loop.hardware.joints
        self._measured = state.position[[joints.index(joint) for joint in self._arm.joints]]

    def move(self, act: Move) -> None:
        """Send a goal with one point."""
        each = dict.fromkeys(self._arm.joints, act.tolerance) if act.tolerance else {}
        point = GoalPoint(self._all(act.positions), act.seconds)
        goal = TrajectoryGoal(self._arm.joints, (point,), Tolerances({} if act.at_end else each, each, act.goal_time_s))
        if act.partial:
            goal = _of_joints(goal, set(act.positions))
        self._send(_reversed(goal) if act.mixed else goal)

    def plan(self, act: FollowPlan) -> None:
        """Send a goal with a dense, time-optimal trajectory, as a planner does."""
        limits = [_scaled(limit, act.scale) for limit in self._limits()]
        here = np.clip(self._here(), [one.lower for one in limits], [one.upper for one in limits])
        motion = motion_to(
            Kinematics.at_rest(here), Kinematics.at_rest(np.array(self._all(act.positions))), limits, 0.0
        )
        times_s = [*np.arange(TABLE_S, motion.duration_s, TABLE_S).tolist(), max(motion.duration_s, TABLE_S / 2.0)]
        goal = TrajectoryGoal(self._arm.joints, tuple(_point(motion.sample(time_s), time_s) for time_s in times_s))
        self._send(_reversed(goal) if act.mixed else goal)

    def waypoints(self, act: FollowWaypoints) -> None:
        """Send a goal with several points without velocities."""
        names = tuple(dict.fromkeys((*act.points[0], *self._arm.joints)))
        here, points = dict(zip(self._arm.joints, self._here().tolist(), strict=True)), []
        for number, positions in enumerate(act.points, 1):
            here |= positions
            points.append(GoalPoint(tuple(here[name] for name in names), number * act.seconds))
        self._send(TrajectoryGoal(names, tuple(points), delay_s=act.delay_s))

    def stream(self, act: Stream) -> Iterator[None]:
        """Publish a point on the trajectory topic in every second cycle."""
        start, goal = self._here(), np.array(self._all(act.positions))
        begun_s = self._stack.clock.now()
        while (share := (self._stack.clock.now() - begun_s + AHEAD_S) / (act.for_s + AHEAD_S)) < 1.0:
            point = GoalPoint(tuple((start + share * (goal - start)).tolist()), AHEAD_S)
            self._send(TrajectoryGoal(self._arm.joints, (point,), from_topic=True))
            yield
            yield

    def jog(self, act: Jog) -> Iterator[None]:
        """Move one joint at a constant velocity, with a point in every second cycle."""
        limits, period_s = self._limits(), 2.0 * self._stack.loop.period_s
        lower, upper = np.array([(one.lower, one.upper) for one in limits]).T
        fastest = np.array([JOG_SHARE * one.velocity for one in limits])
        motion = GuidedMotion(self._here(), lower, upper, fastest)
        velocity = np.where(np.array(self._arm.joints) == act.joint, act.share * fastest, 0.0)
        end_s = self._stack.clock.now() + act.for_s
        while self._stack.clock.now() < end_s and np.isfinite(self._measured).all():
            set_point = motion.go(velocity, period_s, JointPositions(self._here(), self._measured))
            point = GoalPoint(tuple(set_point.tolist()), HORIZON_S)
            self._send(TrajectoryGoal(self._arm.joints, (point,), from_topic=True))
            yield
            yield

    def cancel(self, act: Cancel) -> None:
        """Cancel the newest goal."""
        if self._arm.newest is not None:
            self._arm.cancel(self._arm.newest)

    def _send(self, goal: TrajectoryGoal) -> None:
        if self._arm.check(goal) is None:
            self._arm.submit(goal)

    def _here(self) -> Any:
        """Return the commands (n,) of the arm's joints, in rad or m. A planner starts from the commanded position."""
        loop = self._stack.loop
        return loop.command[[self._names().index(joint) for joint in self._arm.joints]]

    def _all(self, positions: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(positions.get(name, here) for name, here in zip(self._arm.joints, self._here(), strict=True))

    def _names(self) -> list[str]:
        return [name.rpartition("/")[0] for name in self._stack.loop.hardware.command_interfaces]

    def limit_of(self, joint: str) -> JointLimits:
        """Return the limits of any joint of the robot that has a command interface."""
        return self._stack.loop.limits[self._names().index(joint)]

    def _limits(self) -> list[JointLimits]:
        return [self.limit_of(joint) for joint in self._arm.joints]


def _point(state: Kinematics, time_s: float) -> GoalPoint:
    return GoalPoint(
        tuple(state.position.tolist()), time_s, tuple(state.velocity.tolist()), tuple(state.acceleration.tolist())
    )


def _reversed(goal: TrajectoryGoal) -> TrajectoryGoal:
    """Return the same goal with its joints in reverse order."""
    points = tuple(
        replace(
            one, positions=one.positions[::-1], velocities=one.velocities[::-1], accelerations=one.accelerations[::-1]
        )
        for one in goal.points
    )
    return replace(goal, joints=goal.joints[::-1], points=points)


def _of_joints(goal: TrajectoryGoal, joints: Collection[str]) -> TrajectoryGoal:
    """Return the part of a goal with one point that moves these joints."""
    point = goal.points[0]
    kept = [(name, at) for name, at in zip(goal.joints, point.positions, strict=True) if name in joints]
    return replace(
        goal, joints=tuple(name for name, _ in kept), points=(replace(point, positions=tuple(at for _, at in kept)),)
    )


def _scaled(limit: JointLimits, scale: float) -> JointLimits:
    return JointLimits(limit.lower, limit.upper, limit.velocity * scale, limit.acceleration, limit.jerk)
