"""The spec of a controller, as a controllers file or a spawner gives it."""

import re
from dataclasses import dataclass

from controller.parameters import Parameters


def name_mistake(name: str) -> str | None:
    """Why no controller can have that name, or None: its ROS node is called by it, which nobody else checks."""
    if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        return None
    return "cannot be a controller's name: ROS nodes' names are letters, digits and _, and begin with no digit"


@dataclass(frozen=True, slots=True)
class ControllerSpec:
    """The name, type and checked parameters of a controller."""

    name: str
    kind: str
    parameters: Parameters
    fallback: tuple[str, ...] = ()
    """Controllers that take over when it fails."""
    node_arguments: tuple[str, ...] = ()
    """ROS arguments of its node (``--ros-args -r …``)."""
