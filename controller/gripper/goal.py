"""Define gripper goals, their handles and states, and the parameters of a gripper controller."""

from dataclasses import dataclass
from math import isfinite, nan

from pydantic import Field, field_validator

from controller.action_goals import GoalStatus
from controller.parameters import Parameters
from hal.plausible import Effort, MonitorRate, Speed, Time, Tolerance
from hal.types import JointLimits, position_interfaces


class GripperParameters(Parameters):
    """Parameters of a gripper action controller, named as in ros2_control."""

    joint: str = Field(min_length=1)
    action_monitor_rate: MonitorRate = 20.0
    """Rate of the feedback, in Hz."""
    goal_tolerance: Tolerance = 0.01
    allow_stalling: bool = False
    """Whether a stall before the goal counts as success, because the fingers are holding an object."""
    stall_velocity_threshold: Speed = 0.001
    stall_timeout: Time = 1.0
    max_velocity: Speed = 0.0
    """Maximum velocity for goals that do not specify a velocity. 0 selects the joint's limit. ros2_control's default is
    0.1."""
    max_effort: Effort = 0.0
    state_interfaces: tuple[str, ...] = ("position", "velocity")
    max_effort_interface: str = ""
    max_velocity_interface: str = ""

    @field_validator("max_effort_interface")
    @classmethod
    def _no_effort_interface(cls, name: str) -> str:
        if name:
            raise ValueError(
                f"{name} cannot be set by this controller: remove the parameter, and set torque_limit in the robot file"
            )
        return name

    def claims(self) -> tuple[str, ...]:
        return position_interfaces([self.joint])

    def unused(self) -> list[str]:
        unused = []
        if self.max_effort:
            unused.append("max_effort (torque_limit in the robot file limits the force)")
        if self.max_velocity_interface:
            unused.append("max_velocity_interface (the planned motion already limits the velocity)")
        return super().unused() + unused


@dataclass(frozen=True, slots=True)
class GripperGoal:
    """Target position in rad or m, and maximum velocity. A velocity of 0 selects the value from the parameters."""

    position: float
    max_velocity: float = 0.0
    max_effort: float = 0.0


@dataclass(frozen=True, slots=True)
class GripperState:
    """Measured state of a gripper, in rad or m, seconds, and N m or N. Unknown values are NaN."""

    position: float = nan
    velocity: float = nan
    effort: float = nan
    stalled: bool = False
    reached_goal: bool = False


class GripperHandle:
    """An accepted goal. The loop thread sets the result, and any thread may read it."""

    def __init__(self, goal: GripperGoal) -> None:
        self.goal = goal
        self.status = GoalStatus.EXECUTING
        self.state = GripperState()
        """State of the gripper when the goal's result was determined."""
        self.text = ""

    @property
    def done(self) -> bool:
        """Whether the goal has a result."""
        return self.status is not GoalStatus.EXECUTING

    def decide(self, status: GoalStatus, state: GripperState, text: str) -> None:
        """Set the result, unless the goal already has one. Other threads poll the status, so it is set after all other
        fields."""
        if not self.done:
            self.state, self.text = state, text
            self.status = status


def reason_to_reject(goal: GripperGoal, joint: str, limits: JointLimits, parameters: GripperParameters) -> str | None:
    """Return the reason why a goal is rejected, including the invalid values, or None."""
    if not isfinite(goal.position):
        return f"the position of {joint} must be finite, not {goal.position}"
    if not limits.lower <= goal.position <= limits.upper:
        return f"position {goal.position:g} is outside the limits {limits.lower:g} to {limits.upper:g} of {joint}"
    for name, value in (("max velocity", goal.max_velocity), ("max effort", goal.max_effort)):
        if not (isfinite(value) and value >= 0.0):
            return f"{name} of {joint} must be finite and at least 0, not {value}"
    velocity, still = velocity_of(goal, limits, parameters), parameters.stall_velocity_threshold
    if velocity <= still:
        return f"max velocity must be above the stall_velocity_threshold {still:g}, not {velocity:g}"
    return None


def velocity_of(goal: GripperGoal, limits: JointLimits, parameters: GripperParameters) -> float:
    """Return the maximum velocity for a goal, which does not exceed the joint's limit."""
    return min(goal.max_velocity or parameters.max_velocity or limits.velocity, limits.velocity)
