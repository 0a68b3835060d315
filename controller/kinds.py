"""The kinds of controllers that a controllers file can name: ours, and what users install."""

from collections.abc import Mapping
from functools import cache
from importlib import invalidate_caches
from importlib.metadata import entry_points
from typing import Final

from controller.forward_command_controller import (
    ForwardCommandController,
    JointGroupEffortController,
    JointGroupPositionController,
    JointGroupVelocityController,
)
from controller.gripper_action_controller import GripperActionController, PositionGripperActionController
from controller.interface import ControllerType
from controller.joint_state_broadcaster import JointStateBroadcaster
from controller.joint_trajectory_controller import JointTrajectoryController
from controller.servo_state_broadcaster import ServoStateBroadcaster

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


class PluginError(Exception):
    """An installed plug-in cannot be loaded."""


@cache
def _installed() -> tuple[Mapping[str, ControllerType], Mapping[str, str]]:
    """What users installed, by ``type``; and why what is broken is broken."""
    sound: dict[str, ControllerType] = {}
    broken: dict[str, str] = {}
    for point in entry_points(group=ENTRY_POINTS):
        try:
            sound[point.name] = point.load()
        except Exception as error:  # whatever its module does when it is imported
            broken[point.name] = f"the controller {point.name} ({point.value}) cannot be loaded: {error}"
    return sound, broken


def kinds() -> Mapping[str, ControllerType]:
    """All that can be used, by their ``type``. A broken one does not keep the arm from its others."""
    return {**{kind.kind: kind for kind in _OURS}, **_installed()[0]}


def broken() -> Mapping[str, str]:
    """Why installed ones cannot be used, by their ``type``."""
    return _installed()[1]


def look_again() -> None:
    """Plug-ins that have been installed since count from now on."""
    invalidate_caches()
    _installed.cache_clear()
