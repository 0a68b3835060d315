"""Search for other stacks with the same ROS names while a command prepares its own stack."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from nodes.ros_environment import RosMissing, require_ros

if TYPE_CHECKING:
    from nodes.only_one import Search


@contextmanager
def search_for_others(name: str, message: str, namespace: str, ros: bool = True) -> Iterator["Search | None"]:
    """Start searching for another node that has the same name as a node of this stack.

    Start the search before the hardware is opened, because the search takes time. Without ROS, the result is None.

    Args:
        name: Name of the node.
        message: Error message if such a node is found. Its braces are replaced by the full node name.
        namespace: Namespace of the node; empty for the root namespace.
        ros: Whether the stack uses ROS.

    Raises:
        RosError: ROS is installed, but cannot be used.
    """
    try:
        if ros:
            require_ros()
    except RosMissing:
        ros = False
    if not ros:
        yield None
        return
    from nodes.only_one import Search

    with Search(name, namespace, message, _neighbor_in(namespace)) as search:
        yield search


def _neighbor_in(namespace: str) -> bool:
    """Return whether this user is running a stack in the same namespace on this machine, perhaps in another ROS
    domain."""
    from servoloop.recording.stream import running_stacks

    return any(stack.namespace == namespace for stack in running_stacks())
