"""From the controllers file to the controllers."""

from collections.abc import Mapping

from controller.controllers_file import ControllerFile, ControllersFile
from controller.forward_command_controller import ForwardCommandController
from controller.goal import Tolerances
from controller.interface import Controller, Settled, limits_of
from controller.joint_state_broadcaster import JointStateBroadcaster
from controller.joint_trajectory_controller import JointTrajectoryController, JtcSettings
from controller.parameters import ForwardParameters, JointConstraints, TrajectoryParameters
from hal.description import Component, Description
from hal.types import JointLimits


def build(
    file: ControllersFile,
    description: Description,
    component: Component,
    limits: Mapping[str, JointLimits],
    settled: Settled,
) -> list[Controller]:
    """The controllers of the file, in its order."""
    return [_build(c, description, component, limits, settled) for c in file.controllers]


def _build(
    file: ControllerFile,
    description: Description,
    component: Component,
    limits: Mapping[str, JointLimits],
    settled: Settled,
) -> Controller:
    parameters, hardware_joints = file.parameters, component.joints
    if isinstance(parameters, TrajectoryParameters):
        own = limits_of(parameters.joints, limits)
        return JointTrajectoryController(file.name, _settings(parameters), own, hardware_joints, settled)
    if isinstance(parameters, ForwardParameters):
        own = limits_of(parameters.joints, limits)
        return ForwardCommandController(file.name, parameters.joints, own, hardware_joints)
    mimics = {
        name: joint.mimic
        for name, joint in description.joints.items()
        if joint.mimic and name in component.state_interfaces
    }
    return JointStateBroadcaster(file.name, component.state_interfaces, mimics, hardware_joints)


def _settings(file: TrajectoryParameters) -> JtcSettings:
    by_joint: dict[str, JointConstraints] = file.constraints.model_extra or {}
    return JtcSettings(
        joints=file.joints,
        may_end_moving=file.allow_nonzero_velocity_at_trajectory_end,
        tolerances=Tolerances(
            {name: c.trajectory for name, c in by_joint.items()},
            {name: c.goal for name, c in by_joint.items()},
            file.constraints.goal_time,
        ),
        command_lead_s=file.command_lead,
        wait_for=file.wait_for,
        wait_for_timeout_s=file.wait_for_timeout,
    )
