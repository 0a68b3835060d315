"""Generate waypoints for tests: random points, and points like those of a planner such as MoveIt."""

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from controller.motion import Kinematics, Path
from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from controller.trajectory.goal_planner import waypoints_of
from controller.trajectory.waypoints import Waypoints
from hal.types import AT_LIMIT, FloatArray, JointLimits

LIMIT = JointLimits(-3.0, 3.0, 4.0, 12.0, 120.0)
JOINTS = ("a", "b")
LIMITS = (LIMIT, JointLimits(-3.0, 3.0, 2.0, 8.0, 90.0))


def at_rest(*position: float) -> Kinematics:
    return Kinematics.at_rest(np.array(position))


def waypoints(*points: GoalPoint, delay_s: float = 0.0, joints: tuple[str, ...] = JOINTS) -> Waypoints:
    """Return waypoints for all joints."""
    return waypoints_of(TrajectoryGoal(joints, points, delay_s=delay_s), joints, np.zeros(len(joints)))


positions = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
velocities = st.just(()) | st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))


@st.composite
def random_waypoints(draw: st.DrawFn, largest: int = 12) -> Waypoints:
    """Return a few random points of all degrees, close together and far apart."""
    spans = draw(st.lists(st.floats(0.01, 1.5), min_size=1, max_size=largest))
    points = [
        GoalPoint(draw(positions), float(time_s), draw(velocities), draw(st.just(()) | st.just((0.3, -0.3))))
        for time_s in np.cumsum(spans)
    ]
    return waypoints(*points)


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """Motion profile of a planner that has velocity and acceleration limits but no jerk limit."""

    way: float
    velocity: float
    acceleration: float

    @property
    def duration_s(self) -> float:
        return self.way / self.velocity + self.velocity / self.acceleration

    def at(self, time_s: float) -> tuple[float, float, float]:
        ramp_s, rest_s = self.velocity / self.acceleration, self.duration_s - time_s
        if time_s < ramp_s:
            return self.acceleration * time_s**2 / 2, self.acceleration * time_s, self.acceleration
        if rest_s < ramp_s:
            return self.way - self.acceleration * rest_s**2 / 2, self.acceleration * rest_s, -self.acceleration
        return self.velocity * (time_s - ramp_s / 2), self.velocity, 0.0

    def waypoints(self, apart_s: float, fields: int) -> Waypoints:
        """Sample the profile for both joints. The points contain positions, also velocities if ``fields`` is at least
        2, and accelerations if it is 3."""
        times = [*np.arange(0.0, self.duration_s - 1e-6, apart_s), self.duration_s]
        points = []
        for time_s in times:
            p, v, a = self.at(float(time_s))
            if time_s == self.duration_s:
                v, a = 0.0, 0.0
            given = ((p, p / 2), (v, v / 2), (a, a / 2))
            points.append(GoalPoint(given[0], float(time_s), *given[1:fields]))
        return waypoints(*points)


def samples(path: Path, apart_s: float = 0.002) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions, velocities and accelerations (count, n) from the start to shortly after the end."""
    states = [path.sample(t) for t in np.arange(0.0, path.duration_s + 3 * apart_s, apart_s)]
    return (
        np.array([s.position for s in states]),
        np.array([s.velocity for s in states]),
        np.array([s.acceleration for s in states]),
    )


def assert_within(path: Path, limits: tuple[JointLimits, ...] = LIMITS, jerk: bool = True) -> None:
    """Check that the path stays within all limits, including between the points. Without ``jerk``, check only positions
    and velocities."""
    apart_s = 0.002
    position, velocity, acceleration = samples(path, apart_s)
    for joint, limit in enumerate(limits):
        slack = AT_LIMIT * (limit.upper - limit.lower) + 1e-6  # The sampler clips values within this tolerance.
        assert position[:, joint].min() >= limit.lower - slack
        assert position[:, joint].max() <= limit.upper + slack
        assert np.abs(velocity[:, joint]).max() <= limit.velocity * 1.002 + 1e-9
        assert np.abs(np.diff(position[:, joint])).max() <= limit.velocity * apart_s * 1.002 + 1e-9
        if jerk:
            assert np.abs(acceleration[:, joint]).max() <= limit.acceleration * 1.001 + 1e-6
            assert np.abs(np.diff(velocity[:, joint])).max() <= limit.acceleration * apart_s * 1.001 + 1e-6
            assert np.abs(np.diff(acceleration[:, joint])).max() <= limit.jerk * apart_s * 1.001 + 1e-4
