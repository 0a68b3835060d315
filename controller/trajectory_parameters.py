"""The parameters of a joint trajectory controller."""

from typing import Literal

from pydantic import BaseModel, Field

from controller.goal import Tolerances
from controller.parameters import NotNegative, Parameters


class JointConstraints(BaseModel):
    """Tolerances of one joint, rad or m; 0 is none."""

    trajectory: NotNegative = 0.0
    goal: NotNegative = 0.0


class Constraints(Parameters):
    """Tolerances of a trajectory controller: seconds, and by joint."""

    goal_time: NotNegative = 0.0
    stopped_velocity_tolerance: NotNegative = 0.01  # upstream's; acts only on velocity commands, which we have not
    __pydantic_extra__: dict[str, JointConstraints]

    def by_joint(self) -> dict[str, JointConstraints]:
        """What is said of single joints."""
        return self.model_extra or {}


class TrajectoryParameters(Parameters):
    """Of a joint trajectory controller. The last four are ours."""

    joints: tuple[str, ...] = Field(min_length=1)
    command_interfaces: tuple[Literal["position"], ...] = ("position",)
    state_interfaces: tuple[Literal["position", "velocity"], ...] = ("position", "velocity")
    allow_nonzero_velocity_at_trajectory_end: bool = False
    constraints: Constraints = Constraints.model_validate({})
    interpolation_method: Literal["ruckig"] = "ruckig"
    command_lead: NotNegative = 0.0
    wait_for: tuple[str, ...] = ()
    wait_for_timeout: NotNegative = 1.5

    def claims(self) -> tuple[str, ...]:
        return tuple(f"{joint}/{name}" for joint in self.joints for name in self.command_interfaces)

    def unused(self) -> list[str]:
        others = set(self.constraints.by_joint()) - set(self.joints)
        return super().unused() + [f"constraints.{other}" for other in sorted(others)]

    def tolerances(self) -> Tolerances:
        """The defaults for goals that bring none."""
        by_joint = self.constraints.by_joint()
        return Tolerances(
            {name: c.trajectory for name, c in by_joint.items()},
            {name: c.goal for name, c in by_joint.items()},
            self.constraints.goal_time,
        )
