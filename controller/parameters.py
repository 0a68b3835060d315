"""The parameters that each kind of controller takes, under ros2_control's names."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from controller.forward_command_controller import ForwardCommandController
from controller.joint_state_broadcaster import JointStateBroadcaster
from controller.joint_trajectory_controller import JointTrajectoryController

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Parameters(BaseModel):
    """Parameters of a node. Unknown ones are upstream's: they are named in the log, not refused."""

    model_config = ConfigDict(extra="allow", frozen=True)


class ManagerParameters(Parameters):
    """Of the controller manager itself."""

    update_rate: int = Field(100, gt=0, le=1000)  # upstream's default


class JointConstraints(BaseModel):
    """Tolerances of one joint, rad or m; 0 is none."""

    trajectory: NotNegative = 0.0
    goal: NotNegative = 0.0


class Constraints(Parameters):
    """Tolerances of a trajectory controller: seconds, and by joint."""

    goal_time: NotNegative = 0.0
    stopped_velocity_tolerance: NotNegative = 0.01  # upstream's; acts only on velocity commands, which we have not
    __pydantic_extra__: dict[str, JointConstraints]


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


class ForwardParameters(Parameters):
    """Of a forward command controller."""

    joints: tuple[str, ...] = Field(min_length=1)
    interface_name: Literal["position"]


class BroadcasterParameters(Parameters):
    """Of a joint state broadcaster: everything is broadcast."""


KINDS: Mapping[str, type[Parameters]] = {
    JointTrajectoryController.kind: TrajectoryParameters,
    ForwardCommandController.kind: ForwardParameters,
    JointStateBroadcaster.kind: BroadcasterParameters,
}


def commanded_joints(parameters: Parameters) -> tuple[str, ...]:
    """The joints whose command interface the controller claims."""
    return parameters.joints if isinstance(parameters, TrajectoryParameters | ForwardParameters) else ()
