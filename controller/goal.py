"""A trajectory goal: what a client asked for, what became of it, and why it may be refused."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum


class GoalStatus(Enum):
    """Life of an accepted goal."""

    EXECUTING = "executing"
    SUCCEEDED = "succeeded"
    CANCELED = "canceled"
    ABORTED = "aborted"


class ErrorCode:
    """error_code of control_msgs/action/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


@dataclass(frozen=True, slots=True)
class GoalPoint:
    """One way-point in the client's joint order; times in seconds from the trajectory's start."""

    positions: tuple[float, ...]
    time_from_start_s: float
    velocities: tuple[float, ...] = ()
    accelerations: tuple[float, ...] = ()
    has_effort: bool = False


ERASE = -1.0
"""A tolerance that a goal switches off (control_msgs/JointTolerance)."""


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Largest deviations by joint name (rad, m); a joint that is not named has none.

    In a goal 0 stands for the controller's default and ERASE for none at all.
    """

    path: Mapping[str, float] = field(default_factory=dict)
    goal: Mapping[str, float] = field(default_factory=dict)
    goal_time_s: float = 0.0
    """How long after the end the goal tolerance may stay violated; 0: for ever."""


def resolve(asked: Tolerances, default: Tolerances, joints: Sequence[str]) -> Tolerances:
    """What a goal asks for over the defaults. Raises ValueError, saying why, where it makes no sense."""
    for kind, named in (("path", asked.path), ("goal", asked.goal)):
        for name in named:
            if name not in joints:
                raise ValueError(f"joint '{name}' specified in goal.{kind}_tolerance does not exist")
    return Tolerances(
        {name: _resolved(asked.path.get(name, 0.0), default.path.get(name, 0.0)) for name in joints},
        {name: _resolved(asked.goal.get(name, 0.0), default.goal.get(name, 0.0)) for name in joints},
        _resolved(asked.goal_time_s, default.goal_time_s),
    )


def _resolved(asked: float, default: float) -> float:
    if asked == ERASE:
        return 0.0
    if not asked >= 0.0:
        raise ValueError(f"{asked} is no tolerance: more than 0 sets one, 0 is the default and -1 erases it")
    return asked or default


@dataclass(frozen=True, slots=True)
class TrajectoryGoal:
    """What the client sent. ``delay_s`` is its stamp relative to now; 0 means now."""

    joints: tuple[str, ...]
    points: tuple[GoalPoint, ...]
    tolerances: Tolerances = Tolerances()
    delay_s: float = 0.0
    from_topic: bool = False
    """Nobody waits for its end."""
    next_cycle_s: float = 0.0
    """So long from now comes the cycle in which it can begin."""
    begins_s: float | None = None
    """When that is by the loop's clock; None: whenever it is, it is not late."""

    @property
    def starts_s(self) -> float:
        """When its points' times count from, seen from that cycle: a stamp is a point in time, 0 is that cycle."""
        return self.delay_s - self.next_cycle_s if self.delay_s else 0.0


class GoalHandle:
    """An accepted goal. The loop's thread decides it; any thread may look."""

    def __init__(self, goal: TrajectoryGoal) -> None:
        self.goal = goal
        self.status = GoalStatus.EXECUTING
        self.error_code = ErrorCode.SUCCESSFUL
        self.error_text = ""

    @property
    def done(self) -> bool:
        """Whether it is decided."""
        return self.status is not GoalStatus.EXECUTING

    def decide(self, status: GoalStatus, error_code: int, text: str) -> None:
        """The first decision stands; status comes last, because other threads look at it."""
        if not self.done:
            self.error_code, self.error_text = error_code, text
            self.status = status
