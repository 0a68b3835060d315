"""Define the specification (spec) of a controller. A spec is created from a controllers file or by a spawner."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.parameters import Parameters
from hal.robot_description.node_names import LONGEST_NAME, STACK_NODES

ROS_ARGUMENTS: Final = "--ros-args"


def name_mistake(name: str) -> str | None:
    """Return the reason why a controller cannot have this name, or None if the name is valid.

    The ROS node of the controller has the same name.
    """
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        return "is not a valid controller name: use letters, digits and _, and do not start with a digit"
    if len(name) > LONGEST_NAME:
        return f"has {len(name)} characters: shorten the name to at most {LONGEST_NAME}"
    return "is the name of a node of the stack itself: rename the controller" if name in STACK_NODES else None


def with_ros_flag(arguments: Sequence[str]) -> tuple[str, ...]:
    """Return the ROS arguments with a leading ``--ros-args``, which rcl requires but users may omit."""
    return tuple(arguments) if not arguments or ROS_ARGUMENTS in arguments else (ROS_ARGUMENTS, *arguments)


@dataclass(frozen=True, slots=True)
class ControllerSpec:
    """Name, type and validated parameters of a controller."""

    name: str
    kind: str
    parameters: Parameters
    fallback: tuple[str, ...] = ()
    """Controllers that take over if this controller fails."""
    node_arguments: tuple[str, ...] = ()
    """ROS arguments of the controller's node (``--ros-args -r …``)."""
