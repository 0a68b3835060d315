"""A gripper goal, its handle and its state, and the parameters of the gripper's controller."""

from dataclasses import dataclass
from math import isfinite, nan

from pydantic import Field, field_validator

from controller.action_goals import GoalStatus
from controller.parameters import Parameters
from hal.plausible import Effort, MonitorRate, Speed, Time, Tolerance
from hal.types import JointLimits


class GripperParameters(Parameters):
    """Parameters of a gripper action controller, under upstream's names."""

    joint: str = Field(min_length=1)
    action_monitor_rate: MonitorRate = 20.0
    """Feedback in Hz."""
    goal_tolerance: Tolerance = 0.01
    allow_stalling: bool = False
    """Whether fingers that stand still short of the goal have succeeded: they hold something."""
    stall_velocity_threshold: Speed = 0.001
    stall_timeout: Time = 1.0
    max_velocity: Speed = 0.0
    """For goals that name none; 0: the joint's own limit. Upstream's default is 0.1, whatever the joint."""
    max_effort: Effort = 0.0
    state_interfaces: tuple[str, ...] = ("position", "velocity")
    max_effort_interface: str = ""
    max_velocity_interface: str = ""

    @field_validator("max_effort_interface")
    @classmethod
    def _no_effort_interface(cls, name: str) -> str:
        if name:
            raise ValueError(
                f"there is no {name} to pass an effort to: take it out, and set torque_limit in the robot file"
            )
        return name

    def claims(self) -> tuple[str, ...]:
        return (f"{self.joint}/position",)

    def unused(self) -> list[str]:
        told = []
        if self.max_effort:
            told.append("max_effort (torque_limit in the robot file bounds the force)")
        if self.max_velocity_interface:
            told.append("max_velocity_interface (the motion itself keeps to the velocity)")
        return super().unused() + told


@dataclass(frozen=True, slots=True)
class GripperGoal:
    """The position to go to (rad or m) and the largest velocity (0: as the parameters say)."""

    position: float
    max_velocity: float = 0.0
    max_effort: float = 0.0


@dataclass(frozen=True, slots=True)
class GripperState:
    """A gripper's measured state: rad or m, and seconds; N m or N, NaN where unknown."""

    position: float = nan
    velocity: float = nan
    effort: float = nan
    stalled: bool = False
    reached_goal: bool = False


class GripperHandle:
    """One accepted goal. The loop's thread decides it, once; other threads look."""

    def __init__(self, goal: GripperGoal) -> None:
        self.goal = goal
        self.status = GoalStatus.EXECUTING
        self.state = GripperState()
        """The gripper's state when the goal was decided."""
        self.text = ""

    @property
    def done(self) -> bool:
        """Whether the goal is decided."""
        return self.status is not GoalStatus.EXECUTING

    def decide(self, status: GoalStatus, state: GripperState, text: str) -> None:
        """The first decision stands. ``status`` comes last, because other threads look at it."""
        if not self.done:
            self.state, self.text = state, text
            self.status = status


def reason_to_reject(goal: GripperGoal, joint: str, limits: JointLimits, parameters: GripperParameters) -> str | None:
    """The reason why the goal is refused, with the numbers, or None."""
    if not isfinite(goal.position):
        return f"position {goal.position} for {joint}: it must be finite"
    if not limits.lower <= goal.position <= limits.upper:
        return f"position {goal.position:g} is outside the limits {limits.lower:g} to {limits.upper:g} of {joint}"
    for what, value in (("max velocity", goal.max_velocity), ("max effort", goal.max_effort)):
        if not (isfinite(value) and value >= 0.0):
            return f"{what} {value} for {joint}: it must be finite and not negative"
    velocity, still = velocity_of(goal, limits, parameters), parameters.stall_velocity_threshold
    if velocity <= still:
        return f"max velocity {velocity:g} would count as a stall, which begins at {still:g}: ask for more"
    return None


def velocity_of(goal: GripperGoal, limits: JointLimits, parameters: GripperParameters) -> float:
    """The largest velocity for this goal, within the joint's limit."""
    return min(goal.max_velocity or parameters.max_velocity or limits.velocity, limits.velocity)
