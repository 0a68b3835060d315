"""Names of the ROS nodes of a stack. This module does not import any ROS package."""

import re
from typing import Final

STACK_NODES: Final = ("controller_manager", "robot_state_publisher", "ros2_control_node")
"""Names of the nodes that a stack creates for itself."""

LONGEST_NAME: Final = 100
"""Maximum length of a node name and of a namespace, in characters. The names of the node's services and actions are
then shorter than 247 characters, which is the limit of the middleware."""


def component_node(name: str) -> str:
    """Convert a component name, which may be any string, to a valid node name (letters, digits and underscores)."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"_{name}" if name[:1].isdigit() else name
