"""Combine several hardware components, each with its own robot file, into one robot."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from hal.hal_errors import RobotFileError
from hal.robot_description.hardware_info import HardwareInfo
from hal.robot_description.urdf import UrdfJoint
from hal.robot_file.robot import Robot
from hal.robot_file.robot_file import BusFile, JointFile, ParkFile, RobotFile
from hal.types import JointLimits

Part = tuple[HardwareInfo, Robot]

SPEED_UP_S = 0.25
"""Time in which a joint without a robot file reaches its velocity limit, in seconds."""
TAKE_UP_S = 0.1
"""Time in which a joint without a robot file reaches its acceleration limit, in seconds."""


def together(parts: Sequence[Part]) -> Robot:
    """Combine all components into one robot. If there are several components, each bus is named after its component.

    Raises:
        RobotFileError: The robot files contradict each other.
    """
    if not parts:
        return Robot((), RobotFile(joints={}))
    if len(parts) == 1:
        return parts[0][1]
    policies = {robot.file.on_exit for _, robot in parts}
    if len(policies) > 1:
        names = " and ".join(component.name for component, _ in parts)
        raise RobotFileError(f"the robot files of {names} differ in on_exit: write the same value in all of them")
    on_buses = [(component, robot) for component, robot in parts if robot.joints]  # no joints: no bus
    _check_bus_names(on_buses)
    joints = tuple(replace(joint, bus=bus_name(c, joint.bus)) for c, robot in parts for joint in robot.joints)
    file = RobotFile(
        buses=_buses(on_buses) or None,
        joints=_joint_files(parts),
        park=_park([robot.file.park for _, robot in parts if robot.file.park]),
        controller_defaults=_defaults(parts),
        on_exit=policies.pop(),
    )
    return Robot(joints, file)


def bus_name(component: HardwareInfo, bus: str) -> str:
    """Return the name of a component's bus in the combined robot.

    The name is the component's name (``hand``). If the component has several buses, the bus name is appended
    (``hand-left``).
    """
    name = f"{component.name}-{bus}" if bus else component.name
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)


def _check_bus_names(parts: Sequence[Part]) -> None:
    owners: dict[str, str] = {}
    for component, robot in parts:
        for name in (bus_name(component, bus) for bus in robot.file.lines()):
            if name == "world":
                raise RobotFileError(
                    "a component with servos must not be called world, because emulators use PORT.world for the "
                    "simulated world: rename the component in the URDF"
                )
            if name in owners:
                raise RobotFileError(
                    f"two buses are called {name}: rename component {owners[name]} or {component.name}"
                )
            owners[name] = component.name


def limits_of(urdf: UrdfJoint) -> JointLimits:
    """Return the limits of a joint without a robot file."""
    acceleration = urdf.velocity / SPEED_UP_S
    return urdf.limits(acceleration, acceleration / TAKE_UP_S)


def _buses(parts: Sequence[Part]) -> dict[str, BusFile]:
    return {bus_name(c, name): line for c, robot in parts for name, line in robot.file.lines().items()}


def _joint_files(parts: Sequence[Part]) -> dict[str, JointFile]:
    return {
        name: joint.model_copy(update={"bus": bus_name(c, robot.file.bus_of(joint))})
        for c, robot in parts
        for name, joint in robot.file.joints.items()
    }


def _park(parks: Sequence[ParkFile]) -> ParkFile | None:
    if not parks:
        return None
    pose = {joint: position for park in parks for joint, position in park.pose.items()}
    return ParkFile(pose=pose, velocity_scale=min(park.velocity_scale for park in parks))


def _defaults(parts: Sequence[Part]) -> dict[str, dict[str, Any]]:
    defaults: dict[str, dict[str, Any]] = {}
    for _, robot in parts:
        for name, values in robot.file.controller_defaults.items():
            defaults.setdefault(name, {}).update(values)
    return defaults


def all_limits(
    components: Sequence[HardwareInfo], robot: Robot, urdf: Mapping[str, UrdfJoint]
) -> dict[str, JointLimits]:
    """Return the limits of every commanded joint, taken from its robot file or, if there is none, from the URDF."""
    limits = robot.limits()
    for component in components:
        for joint, commands in component.command_interfaces.items():
            if commands and joint not in limits:
                limits[joint] = limits_of(urdf[joint])
    return limits
