"""Plug-ins: the types of controllers that a controllers file can name, ours and those that users install."""

import sys
from collections.abc import Mapping
from functools import cache
from importlib import invalidate_caches
from importlib.metadata import EntryPoint, entry_points
from typing import Final

from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster
from controller.broadcasters.servo_state_broadcaster import ServoStateBroadcaster
from controller.forward.forward_command_controller import (
    ForwardCommandController,
    JointGroupEffortController,
    JointGroupPositionController,
    JointGroupVelocityController,
)
from controller.gripper.gripper_action_controller import GripperActionController, PositionGripperActionController
from controller.interface import ControllerType
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController

ENTRY_POINTS: Final = "servoloop.controllers"
"""The group of entry points in which a user's package names its controllers: ``package/Class = module:Class``."""


_OURS: Final[tuple[ControllerType, ...]] = (
    JointTrajectoryController,
    ForwardCommandController,
    JointGroupPositionController,
    JointGroupVelocityController,
    JointGroupEffortController,
    GripperActionController,
    PositionGripperActionController,
    JointStateBroadcaster,
    ServoStateBroadcaster,
)


_TRAJECTORIES: Final = "joint_trajectory_controller/JointTrajectoryController"
SUCCESSORS: Final[Mapping[str, str]] = {
    "joint_state_controller/JointStateController": "joint_state_broadcaster/JointStateBroadcaster",
    "position_controllers/JointTrajectoryController": _TRAJECTORIES,
    "velocity_controllers/JointTrajectoryController": _TRAJECTORIES,
    "effort_controllers/JointTrajectoryController": _TRAJECTORIES,
    "position_controllers/JointPositionController": "position_controllers/JointGroupPositionController",
    "effort_controllers/GripperActionController": "parallel_gripper_action_controller/GripperActionController",
}
"""Types of older releases, and the types that took their place."""


def outdated(kind: str) -> str | None:
    """The remedy for a type of an older release; None for any other type."""
    return f"its type {kind} is outdated: write {SUCCESSORS[kind]}" if kind in SUCCESSORS else None


class PluginError(Exception):
    """An installed plug-in cannot be loaded."""


@cache
def _installed() -> tuple[Mapping[str, ControllerType], Mapping[str, str]]:
    """Installed controller types, by ``type``; and the reasons why broken ones are broken."""
    sound: dict[str, ControllerType] = {}
    broken_plugins: dict[str, str] = {}
    for point in entry_points(group=ENTRY_POINTS):
        try:
            sound[point.name] = point.load()
        except Exception as error:  # whatever its module does when it is imported
            broken_plugins[point.name] = f"the controller {point.name} {why_not_loaded(point, error)}"
    return sound, broken_plugins


def why_not_loaded(point: EntryPoint, error: Exception) -> str:
    """The reason why an installed class cannot be loaded, for a message that begins with its type."""
    remedy = ""
    if point.module.split(".")[0] in sys.stdlib_module_names:
        remedy = f"; Python's own module {point.module} is found instead: rename {point.module}.py in the package"
    return f"({point.value}) cannot be loaded: {error}{remedy}"


def controller_types() -> Mapping[str, ControllerType]:
    """All usable controller types, by their ``type``. A broken one does not keep the arm from its others."""
    return {**{kind.kind: kind for kind in _OURS}, **_installed()[0]}


def broken_plugins() -> Mapping[str, str]:
    """The reasons why installed types cannot be used, by their ``type``."""
    return _installed()[1]


def look_for_plugins_again() -> None:
    """Plug-ins that have been installed since count from now on."""
    invalidate_caches()
    _installed.cache_clear()
