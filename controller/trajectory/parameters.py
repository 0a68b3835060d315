"""Define the parameters of a joint trajectory controller, using ros2_control's names and defaults."""

from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from controller.parameters import Parameters
from controller.trajectory.goal import Allowed
from controller.trajectory.tolerances import Tolerances
from hal.plausible import Deceleration, Factor, MonitorRate, Speed, Time, Tolerance
from hal.types import position_interfaces

SETTABLE: Final = frozenset(
    {
        "allow_partial_joints_goal",
        "allow_integration_in_goal_trajectories",
        "allow_nonzero_velocity_at_trajectory_end",
        "cmd_timeout",
        "command_lead",
        "constraints",
    }
)
"""Parameters and parameter groups that can be changed while the controller is running."""


class JointConstraints(BaseModel):
    """Constraints of one joint. Tolerances are in rad or m; 0 disables a tolerance."""

    model_config = ConfigDict(extra="allow", frozen=True)

    trajectory: Tolerance = 0.0
    goal: Tolerance = 0.0
    lag_time: Time = 0.0
    """Lag that is allowed for a moving joint, in seconds (not available in ros2_control).

    The joint's error may exceed ``trajectory`` by the joint's speed times this value.
    """
    max_deceleration_on_cancel: Deceleration = 0.0
    """Maximum deceleration in rad/s² or m/s². 0 selects the joint's limit, which is never exceeded."""


class Constraints(Parameters):
    """Constraints of a trajectory controller. Additional fields contain the constraints of each joint."""

    goal_time: Time = 0.0
    # ros2_control applies this tolerance only to velocity commands, which this controller does not send.
    stopped_velocity_tolerance: Speed = 0.01
    decelerate_on_cancel: bool = True
    """Whether joints decelerate when a goal is canceled.

    The default intentionally differs from that of ros2_control. If False, the measured position is commanded
    immediately, at any speed.
    """
    __pydantic_extra__: dict[str, JointConstraints]

    def by_joint(self) -> dict[str, JointConstraints]:
        """Return the constraints of each joint, keyed by name."""
        return self.model_extra or {}


class ScalingParameters(BaseModel):
    """Parameters for speed scaling. ros2_control's parameters for hardware interfaces have no effect."""

    model_config = ConfigDict(extra="allow", frozen=True)

    initial_scaling_factor: Factor = 1.0


class TrajectoryParameters(Parameters):
    """Parameters of the trajectory controller.

    The last three parameters and ``interpolation_method: ruckig`` do not exist in ros2_control.
    """

    joints: tuple[str, ...] = Field(min_length=1)
    command_interfaces: tuple[Literal["position", "velocity", "acceleration", "effort"], ...] = ("position",)
    """Command interfaces, which must include position. Other entries are ignored, because servos accept only
    positions."""
    state_interfaces: tuple[Literal["position", "velocity"], ...] = ("position", "velocity")
    allow_partial_joints_goal: bool = False
    allow_integration_in_goal_trajectories: bool = False
    allow_nonzero_velocity_at_trajectory_end: bool = False
    action_monitor_rate: MonitorRate = 20.0
    cmd_timeout: Time = 0.0
    speed_scaling: ScalingParameters = ScalingParameters()
    constraints: Constraints = Field(Constraints.model_validate({}), validate_default=True)
    interpolation_method: Literal["splines", "none", "ruckig"] = "splines"
    """Interpolation method, with the same default as in ros2_control. servoloop's robot files set ruckig (jerk-limited)
    for controllers files without this parameter.
    """
    command_lead: Time | None = None
    """Time by which each command is sent early to compensate for servo lag, in seconds.

    If None, the known lag of each servo is used.
    """
    wait_for: tuple[str, ...] = ()
    """Controllers that must settle before a goal starts.

    A client's timeout starts when the goal is accepted. MoveIt cancels a goal after 1.1 times its duration plus 0.5 s.
    For MoveIt, keep ``wait_for_timeout`` below 0.5 s or increase MoveIt's ``allowed_goal_duration_margin``.
    """
    wait_for_timeout: Time = 1.5
    """Maximum time that a goal waits for the controllers in ``wait_for``, in seconds. After this time, the goal starts
    anyway.
    """

    @field_validator("command_interfaces")
    @classmethod
    def _has_position(cls, kinds: tuple[str, ...]) -> tuple[str, ...]:
        if "position" not in kinds:
            raise ValueError(f"'position' is missing in [{', '.join(kinds)}]: use [position]")
        return kinds

    @field_validator("constraints")
    @classmethod
    def _every_joint(cls, constraints: Constraints, info: ValidationInfo) -> Constraints:
        """Add constraints for joints that do not have any, so that their parameters exist and can be set later."""
        known = constraints.by_joint()
        others: dict[str, dict[str, float]] = {n: {} for n in info.data.get("joints", ()) if n not in known}
        return Constraints.model_validate(constraints.model_dump() | others) if others else constraints

    def claims(self) -> tuple[str, ...]:
        return position_interfaces(self.joints)

    def unused(self) -> list[str]:
        others = set(self.constraints.by_joint()) - set(self.joints)
        kinds = [f"command_interfaces: {kind}" for kind in self.command_interfaces if kind != "position"]
        return super().unused() + [f"constraints.{other}" for other in sorted(others)] + kinds

    def tolerances(self) -> Tolerances:
        """Return the default tolerances for goals that do not specify any."""
        by_joint = self.constraints.by_joint()
        return Tolerances(
            {name: c.trajectory for name, c in by_joint.items()},
            {name: c.goal for name, c in by_joint.items()},
            self.constraints.goal_time,
            {name: c.lag_time for name, c in by_joint.items()},
        )

    def allowed(self) -> Allowed:
        """Return the special types of goals that are allowed."""
        return Allowed(
            self.allow_partial_joints_goal,
            self.allow_integration_in_goal_trajectories,
            self.allow_nonzero_velocity_at_trajectory_end,
        )
