"""Find out whether a motion planner is running."""

from typing import Final

from rclpy.node import Node

PLANNER_SERVICE: Final = "move_action/_action/send_goal"
"""Service of the action that clients use to plan."""


def is_planner_present(node: Node) -> bool:
    """Return whether a node provides the action move_action in the namespace of this node."""
    return node.resolve_service_name(PLANNER_SERVICE) in {name for name, _ in node.get_service_names_and_types()}
