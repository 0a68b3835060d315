"""Motion requests for a group of joints, and their results."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hal.types import FloatArray
from planning.collision import Margins
from planning.constraints import PathConstraints
from planning.kinematics.cartesian import Steps
from planning.kinematics.chain import ToolPose
from planning.kinematics.goals import PoseGoal
from planning.paths.margins import PathMargins
from planning.paths.request import Remaining
from planning.paths.timing import TimedPath
from planning.planning_errors import PlanningError
from planning.scene import Pose, Scene

State = Mapping[str, float]
"""Positions of all driven joints of a robot, keyed by joint name, in rad or m."""


@dataclass(frozen=True, slots=True)
class JointGoal:
    """Positions of some joints of a group. The other joints of the group keep their start positions."""

    positions: Mapping[str, float]
    """Positions keyed by joint name, in rad or m."""
    tolerances: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Maximum deviations below and above the position, keyed by joint name, in rad or m. Joints without an entry have
    no tolerance.
    """


@dataclass(frozen=True, slots=True, eq=False)
class ToolGoal:
    """A region of poses for a link, in the robot's frame."""

    goal: PoseGoal
    link: str | None = None
    """Link or site to move to the pose, or the tip of the group if None."""
    offset: Pose = field(default_factory=Pose)
    """Frame to move to the pose, relative to the link to which the frame is fixed."""


Goal = JointGoal | ToolGoal


@dataclass(frozen=True, slots=True)
class Scaling:
    """MoveIt's scaling factors for a motion, above 0 and at most 1."""

    velocity: float = 1.0
    acceleration: float = 1.0
    """Factor applied to the accelerations and jerks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionRequest:
    """A motion from a state to the nearest of several goals."""

    start: State
    goals: Sequence[Goal]
    scene: Scene
    remaining_s: Remaining
    """Function that returns the remaining planning time, in seconds."""
    constraints: PathConstraints = field(default_factory=PathConstraints)
    """Constraints that the motion must satisfy."""
    planner_id: str = ""
    """ID of MoveIt's planner, which is RRT-Connect by default."""
    searches: int = 2
    """Maximum number of searches. The shortest path found is used."""
    scaling: Scaling = field(default_factory=Scaling)
    margins: Margins = field(default_factory=Margins)
    """Distances that the motion must keep from obstacles."""
    seed: int = 1
    """Seed for all random numbers, at least 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineRequest:
    """A straight motion of a link through waypoints."""

    start: State
    waypoints: Sequence[ToolPose]
    """Poses after the start, in the robot's frame."""
    scene: Scene
    link: str | None = None
    """Link or site that moves along the line, or the tip of the group if None."""
    offset: Pose = field(default_factory=Pose)
    """Frame that moves along the line, relative to the link to which the frame is fixed."""
    steps: Steps = field(default_factory=Steps)
    scaling: Scaling = field(default_factory=Scaling)
    margins: Margins = field(default_factory=Margins)
    avoid_collisions: bool = True
    constraints: PathConstraints = field(default_factory=PathConstraints)
    """Constraints that the motion satisfies."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A timed motion of a group."""

    joints: tuple[str, ...]
    """Names of the joints (n), in the order used by the path."""
    path: TimedPath
    """Times, positions, velocities and accelerations."""
    end: State
    """Positions of all driven joints at the end."""
    margins: PathMargins
    """Margins that every segment of the path satisfies."""
    search_s: float = 0.0
    """Time spent on inverse kinematics and the search, in seconds."""
    timing_s: float = 0.0
    """Time spent on computing the timing of the path, in seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class LineMotion:
    """A straight motion, which may end early."""

    motion: Motion | None
    """The part of the motion that is possible, or None if not even the first step is possible."""
    fraction: float
    """Fraction of the path through the waypoints that was completed, from 0 to 1."""
    reason: str = ""
    """Reason why the motion ends early, or empty if the motion is complete."""


@dataclass(frozen=True, slots=True)
class Touch:
    """Two links or objects that are in contact."""

    one: str
    other: str
    distance_m: float
    """Distance in m. In contact, the value is 0 or negative, but it does not represent the penetration depth."""


@dataclass(frozen=True, slots=True)
class Validity:
    """Check of one state."""

    touches: tuple[Touch, ...]
    """Pairs in contact, closest first."""
    outside: str
    """Description of the first joint outside its limits, or empty if there is no such joint."""
    clearance_m: float
    """Smallest distance, in m, or infinity if nothing can touch."""

    @property
    def is_valid(self) -> bool:
        """Whether the state is within the limits and free of contacts."""
        return not self.touches and not self.outside


@dataclass(frozen=True, slots=True)
class FutureContact:
    """Point of a timed motion at which the arm comes too close to an obstacle."""

    time_s: float
    """Time since the start of the motion, in seconds."""
    one: str
    other: str


def no_goal() -> PlanningError:
    """Return the error for a request without goals."""
    return PlanningError("INVALID_GOAL_CONSTRAINTS", "the request has no goal: specify joint positions or a pose")


def positions_of(state: State, joints: Sequence[str]) -> list[float]:
    """Return the positions of joints (n) in a state."""
    return [state[joint] for joint in joints]


def with_positions(state: State, joints: Sequence[str], positions: FloatArray) -> dict[str, float]:
    """Return a state in which some joints have new positions (n,)."""
    return {**state, **dict(zip(joints, positions.tolist(), strict=True))}
