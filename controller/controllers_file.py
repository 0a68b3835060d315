"""The controllers file, in ros2_control's own format, and the controllers that it describes."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, RootModel, ValidationError

from controller.forward_command_controller import ForwardCommandController
from controller.goal import Tolerances
from controller.interface import Controller, Settled, limits_of
from controller.joint_state_broadcaster import JointStateBroadcaster
from controller.joint_trajectory_controller import JointTrajectoryController, JtcSettings
from hal.description import Component, Description
from hal.types import JointLimits
from hal.yaml_file import load

LOG = logging.getLogger("servoloop.controller")

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class ControllersFileError(Exception):
    """The controllers file has mistakes; the text lists them with file and line."""


class _Parameters(BaseModel):
    """Parameters of a node. Unknown ones are upstream's: they are named in the log, not refused."""

    model_config = ConfigDict(extra="allow", frozen=True)


class _Node(BaseModel):
    ros__parameters: dict[str, Any] = {}


class _File(RootModel[dict[str, _Node]]):
    pass


class _Manager(_Parameters):
    update_rate: int = Field(100, gt=0, le=1000)  # upstream's default


class _JointConstraints(BaseModel):
    trajectory: NotNegative = 0.0
    goal: NotNegative = 0.0


class _Constraints(_Parameters):
    goal_time: NotNegative = 0.0
    stopped_velocity_tolerance: NotNegative = 0.01  # upstream's; acts only on velocity commands, which we have not
    __pydantic_extra__: dict[str, _JointConstraints]


class _Jtc(_Parameters):
    joints: tuple[str, ...] = Field(min_length=1)
    command_interfaces: tuple[Literal["position"], ...] = ("position",)
    state_interfaces: tuple[Literal["position", "velocity"], ...] = ("position", "velocity")
    allow_nonzero_velocity_at_trajectory_end: bool = False
    interpolation_method: Literal["ruckig"] = "ruckig"
    constraints: _Constraints = _Constraints.model_validate({})
    command_lead: NotNegative = 0.0
    wait_for: tuple[str, ...] = ()
    wait_for_timeout: NotNegative = 1.5


class _Forward(_Parameters):
    joints: tuple[str, ...] = Field(min_length=1)
    interface_name: Literal["position"]


class _Broadcaster(_Parameters):
    pass


@dataclass(frozen=True, slots=True)
class ControllerFile:
    """One controller: its name, type and checked parameters."""

    name: str
    kind: str
    parameters: _Parameters


@dataclass(frozen=True, slots=True)
class ControllersFile:
    """The whole file, checked."""

    path: Path
    update_rate_hz: int
    controllers: tuple[ControllerFile, ...]


_KINDS: Mapping[str, type[_Parameters]] = {
    JointTrajectoryController.kind: _Jtc,
    ForwardCommandController.kind: _Forward,
    JointStateBroadcaster.kind: _Broadcaster,
}


def load_controllers_file(
    path: Path, defaults: Mapping[str, Mapping[str, Any]], component: Component
) -> ControllersFile:
    """Read and check the file; ``defaults`` by controller fill in what it does not say.

    Raises ControllersFileError with every mistake.
    """
    nodes = load(path, _File, ControllersFileError).root
    manager = nodes.get("controller_manager")
    if manager is None:
        raise ControllersFileError(f"{path} has no controller_manager")
    problems: list[str] = []
    controllers: list[ControllerFile] = []
    for name, entry in manager.ros__parameters.items():
        if isinstance(entry, dict) and "type" in entry:
            own = nodes[name].ros__parameters if name in nodes else {}
            parameters = {**defaults.get(name, {}), **own}
            problems += _bad_waits(path, name, own.get("wait_for"), manager.ros__parameters)
            controllers += _controller(path, name, str(entry["type"]), parameters, problems)
    if not controllers:
        problems.append(f"{path}: controller_manager names no controllers")
    problems += _unknown_joints(path, controllers, component)
    problems += _claimed_twice(path, controllers)
    rate = _checked(path, "controller_manager", _Manager, manager.ros__parameters, problems)
    if problems or not isinstance(rate, _Manager):
        raise ControllersFileError("\n".join(problems))
    return ControllersFile(path, rate.update_rate, tuple(controllers))


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
    if isinstance(parameters, _Jtc):
        own = limits_of(parameters.joints, limits)
        return JointTrajectoryController(file.name, _jtc_settings(parameters), own, hardware_joints, settled)
    if isinstance(parameters, _Forward):
        own = limits_of(parameters.joints, limits)
        return ForwardCommandController(file.name, parameters.joints, own, hardware_joints)
    mimics = {
        name: joint.mimic
        for name, joint in description.joints.items()
        if joint.mimic and name in component.state_interfaces
    }
    return JointStateBroadcaster(file.name, component.state_interfaces, mimics, hardware_joints)


def _jtc_settings(file: _Jtc) -> JtcSettings:
    named: dict[str, _JointConstraints] = file.constraints.model_extra or {}
    by_joint = {n: named[n] for n in file.joints if n in named}
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


def _controller(
    path: Path, name: str, kind: str, parameters: Mapping[str, Any], problems: list[str]
) -> list[ControllerFile]:
    model = _KINDS.get(kind)
    if model is None:
        problems.append(f"{path}: {name}: unknown type '{kind}', known are {', '.join(_KINDS)}")
        return []
    checked = _checked(path, name, model, parameters, problems)
    if checked is None:
        return []
    if checked.model_extra and model is not _Broadcaster:
        LOG.warning("%s: %s: not used: %s", path, name, ", ".join(sorted(checked.model_extra)))
    return [ControllerFile(name, kind, checked)]


def _checked(
    path: Path,
    name: str,
    model: type[_Parameters],
    parameters: Mapping[str, Any],
    problems: list[str],
) -> _Parameters | None:
    try:
        return model.model_validate(dict(parameters))
    except ValidationError as error:
        for item in error.errors():
            where = ".".join((name, *map(str, item["loc"])))
            problems.append(f"{path}: {where}: {item['msg']}")
        return None


def _unknown_joints(path: Path, controllers: list[ControllerFile], component: Component) -> list[str]:
    known = component.joints
    return [
        f"{path}: {c.name}.joints names {joint}, which takes no commands in the URDF's "
        f"<ros2_control> block (it has {', '.join(known)})"
        for c in controllers
        if isinstance(c.parameters, _Jtc | _Forward)
        for joint in c.parameters.joints
        if joint not in known
    ]


def _claimed_twice(path: Path, controllers: list[ControllerFile]) -> list[str]:
    problems: list[str] = []
    owners: dict[str, str] = {}
    for c in controllers:
        for joint in c.parameters.joints if isinstance(c.parameters, _Jtc | _Forward) else ():
            other = owners.setdefault(joint, c.name)
            if other != c.name:
                problems.append(f"{path}: {other} and {c.name} both command {joint}: a joint belongs to one controller")
        problems += _named_twice(path, c)
    return problems


def _named_twice(path: Path, file: ControllerFile) -> list[str]:
    joints = file.parameters.joints if isinstance(file.parameters, _Jtc | _Forward) else ()
    twice = sorted({joint for joint in joints if joints.count(joint) > 1})
    return [f"{path}: {file.name}.joints names {joint} twice" for joint in twice]


def _bad_waits(path: Path, name: str, waits: Any, known: Mapping[str, Any]) -> list[str]:
    """Who waits for nobody does not wait. The robot file's defaults may name one that this file has not."""
    names = waits if isinstance(waits, list) else []
    return [
        f"{path}: {name}.wait_for names {other}, which is no other controller of this file"
        for other in names
        if other == name or other not in known
    ]
