"""Find the controller types that a controllers file can specify: built-in types and installed plugins."""

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
"""Entry-point group for controllers in user packages. An entry has the form ``package/Class = module:Class``."""


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
"""Controller types of older ros2_control releases, and the types that replaced them."""


def outdated(kind: str) -> str | None:
    """Return the error message for a type from an older release, or None for any other type."""
    return f"its type {kind} is outdated: use {SUCCESSORS[kind]}" if kind in SUCCESSORS else None


@cache
def _installed() -> tuple[Mapping[str, ControllerType], Mapping[str, str]]:
    """Return the installed controller types, and the errors for types that cannot be loaded, both keyed by ``type``."""
    sound: dict[str, ControllerType] = {}
    broken_plugins: dict[str, str] = {}
    for point in entry_points(group=ENTRY_POINTS):
        try:
            sound[point.name] = point.load()
        except Exception as error:  # Importing a user's module can raise any error.
            broken_plugins[point.name] = f"the controller {point.name} {why_not_loaded(point, error)}"
    return sound, broken_plugins


def why_not_loaded(point: EntryPoint, error: Exception) -> str:
    """Return the reason why an installed class cannot be loaded.

    The text completes a message that starts with the type name.
    """
    remedy = ""
    if point.module.split(".")[0] in sys.stdlib_module_names:
        remedy = f"; Python imports its own module {point.module} instead: rename {point.module}.py in the package"
    return f"({point.value}) cannot be loaded: {error}{remedy}"


def controller_types() -> Mapping[str, ControllerType]:
    """Return all usable controller types, keyed by ``type``. A broken plugin does not affect the other types."""
    return {**{kind.kind: kind for kind in _OURS}, **_installed()[0]}


def broken_plugins() -> Mapping[str, str]:
    """Return the errors for installed types that cannot be used, keyed by ``type``."""
    return _installed()[1]


def look_for_plugins_again() -> None:
    """Discard the cached plugins, so that newly installed plugins are found."""
    invalidate_caches()
    _installed.cache_clear()
