"""The spec of a controller, as a controllers file or a spawner gives it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.parameters import Parameters

ROS_ARGUMENTS: Final = "--ros-args"


def name_mistake(name: str) -> str | None:
    """Why no controller can have that name, or None: its ROS node is called by it, which nobody else checks."""
    if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        return None
    return "cannot be a controller's name: ROS nodes' names are letters, digits and _, and begin with no digit"


def with_ros_flag(arguments: Sequence[str]) -> tuple[str, ...]:
    """ROS arguments behind ``--ros-args``, which rcl asks for and the user may leave out."""
    return tuple(arguments) if not arguments or ROS_ARGUMENTS in arguments else (ROS_ARGUMENTS, *arguments)


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
