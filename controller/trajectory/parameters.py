"""The parameters of a joint trajectory controller, under upstream's names and with its defaults."""

from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from controller.parameters import Parameters
from controller.trajectory.goal import Allowed
from controller.trajectory.tolerances import Tolerances
from hal.plausible import Deceleration, Factor, MonitorRate, Speed, Time, Tolerance

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
"""The parameters and groups that can be set while the controller runs."""


class JointConstraints(BaseModel):
    """The constraints of one joint: tolerances in rad or m, 0 is none."""

    model_config = ConfigDict(frozen=True)

    trajectory: Tolerance = 0.0
    goal: Tolerance = 0.0
    lag_time: Time = 0.0
    """Ours, in s: a joint that moves may be further off its path than ``trajectory`` by its speed times this."""
    max_deceleration_on_cancel: Deceleration = 0.0
    """rad/s² or m/s²; 0 is the joint's own limit, which is never exceeded."""


class Constraints(Parameters):
    """Tolerances of a trajectory controller: seconds, and by joint."""

    goal_time: Time = 0.0
    stopped_velocity_tolerance: Speed = 0.01  # upstream's; acts only on velocity commands, which we have not
    decelerate_on_cancel: bool = True
    """Ours, on purpose: upstream's default false steps back to the measured position, at any speed."""
    __pydantic_extra__: dict[str, JointConstraints]

    def by_joint(self) -> dict[str, JointConstraints]:
        """The constraints of single joints, by name."""
        return self.model_extra or {}


class Scaling(BaseModel):
    """Parameters of speed scaling; upstream's exchange with hardware interfaces is not used."""

    model_config = ConfigDict(frozen=True)

    initial_scaling_factor: Factor = 1.0


class TrajectoryParameters(Parameters):
    """Parameters of the trajectory controller. The last three are ours, and so is ``interpolation_method: ruckig``."""

    joints: tuple[str, ...] = Field(min_length=1)
    command_interfaces: tuple[Literal["position", "velocity", "acceleration", "effort"], ...] = ("position",)
    """Servos take positions: the others of a list that has position are not used."""
    state_interfaces: tuple[Literal["position", "velocity"], ...] = ("position", "velocity")
    allow_partial_joints_goal: bool = False
    allow_integration_in_goal_trajectories: bool = False
    allow_nonzero_velocity_at_trajectory_end: bool = False
    action_monitor_rate: MonitorRate = 20.0
    cmd_timeout: Time = 0.0
    speed_scaling: Scaling = Scaling()
    constraints: Constraints = Field(Constraints.model_validate({}), validate_default=True)
    interpolation_method: Literal["splines", "none", "ruckig"] = "splines"
    """Upstream's default. Our robot files say ruckig (jerk-limited) where the controllers file says nothing."""
    command_lead: Time | None = None
    """The servos' lag behind their goals (s): so much earlier each goal is sent. None: as is known of each servo."""
    wait_for: tuple[str, ...] = ()
    """Controllers that must have settled before a goal begins. A client's patience counts from acceptance:
    MoveIt cancels after 1.1 times the duration and 0.5 s, so keep ``wait_for_timeout`` within 0.5 s for it, or
    raise its ``allowed_goal_duration_margin``."""
    wait_for_timeout: Time = 1.5

    @field_validator("command_interfaces")
    @classmethod
    def _has_position(cls, kinds: tuple[str, ...]) -> tuple[str, ...]:
        if "position" not in kinds:
            raise ValueError(f"'position' is not among {', '.join(kinds) or 'no interfaces'}: write [position]")
        return kinds

    @field_validator("constraints")
    @classmethod
    def _every_joint(cls, constraints: Constraints, info: ValidationInfo) -> Constraints:
        """Each joint has its parameters, said or not: so they can be set later."""
        known = constraints.by_joint()
        others: dict[str, dict[str, float]] = {n: {} for n in info.data.get("joints", ()) if n not in known}
        return Constraints.model_validate(constraints.model_dump() | others) if others else constraints

    def claims(self) -> tuple[str, ...]:
        return tuple(f"{joint}/position" for joint in self.joints)

    def unused(self) -> list[str]:
        others = set(self.constraints.by_joint()) - set(self.joints)
        kinds = [f"command_interfaces: {kind}" for kind in self.command_interfaces if kind != "position"]
        return super().unused() + [f"constraints.{other}" for other in sorted(others)] + kinds

    def tolerances(self) -> Tolerances:
        """The defaults for goals that bring none."""
        by_joint = self.constraints.by_joint()
        return Tolerances(
            {name: c.trajectory for name, c in by_joint.items()},
            {name: c.goal for name, c in by_joint.items()},
            self.constraints.goal_time,
            {name: c.lag_time for name, c in by_joint.items()},
        )

    def allowed(self) -> Allowed:
        """The goals beyond the ordinary that are allowed."""
        return Allowed(
            self.allow_partial_joints_goal,
            self.allow_integration_in_goal_trajectories,
            self.allow_nonzero_velocity_at_trajectory_end,
        )
