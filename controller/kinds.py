"""The kinds of controllers that a controllers file can name: ours, and what users install."""

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from typing import Final

from controller.forward_command_controller import ForwardCommandController
from controller.interface import ControllerType
from controller.joint_state_broadcaster import JointStateBroadcaster
from controller.joint_trajectory_controller import JointTrajectoryController

ENTRY_POINTS: Final = "servoloop.controllers"
"""The group of entry points in which a user's package names its controllers: ``package/Class = module:Class``."""


class PluginError(Exception):
    """An installed plug-in cannot be loaded."""


@cache
def kinds() -> Mapping[str, ControllerType]:
    """All by their ``type``. Raises PluginError where an installed one is broken."""
    found: dict[str, ControllerType] = {
        kind.kind: kind for kind in (JointTrajectoryController, ForwardCommandController, JointStateBroadcaster)
    }
    for point in entry_points(group=ENTRY_POINTS):
        try:
            found[point.name] = point.load()
        except Exception as error:  # whatever its module does when it is imported
            raise PluginError(f"the controller {point.name} ({point.value}) cannot be loaded: {error}") from error
    return found
