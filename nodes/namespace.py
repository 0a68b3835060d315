"""ROS namespaces, which allow the nodes of several stacks to share one domain. This module does not import any ROS
package."""

import re
from typing import Final, Protocol

from drivers.driver_errors import DriverError
from hal.robot_description.node_names import LONGEST_NAME


class _Named(Protocol):
    """A node of rclpy."""

    def get_namespace(self) -> str: ...


_PART: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def parse_namespace(text: str) -> str:
    """Return the namespace that a user specifies, interpreted as rcl interprets a node's namespace.

    Args:
        text: The namespace, with or without a leading slash.

    Returns:
        The absolute namespace, such as ``/left``; empty for the root namespace.

    Raises:
        DriverError: The string is not a valid namespace.
    """
    parts = text.removeprefix("/").split("/")
    if parts == [""]:
        return ""
    if not all(_PART.fullmatch(part) and "__" not in part for part in parts):
        raise DriverError(
            f"{text!r} is not a namespace: use letters, digits and single underscores, such as left or lab/left. "
            "The parts between slashes cannot be empty or start with a digit"
        )
    if len(text) > LONGEST_NAME:
        raise DriverError(f"the namespace {text} has {len(text)} characters: shorten it to at most {LONGEST_NAME}")
    return "/" + "/".join(parts)


def namespace_arguments(namespace: str) -> list[str]:
    """Return the ROS arguments that put all nodes of a process in an absolute namespace."""
    return ["--ros-args", "-r", f"__ns:={namespace}"] if namespace else []


def namespace_of(node: _Named) -> str:
    """Return the absolute namespace of a node; empty for the root namespace."""
    found = node.get_namespace()
    return "" if found == "/" else found


def frame_prefix(namespace: str) -> str:
    """Return the prefix that distinguishes the frames of one namespace from those of other namespaces on /tf."""
    return f"{namespace[1:]}/" if namespace else ""
