"""Check whether a motion planner is running."""

from typing import Final

from rclpy.node import Node

PLANNER_SERVICE: Final = "move_action/_action/send_goal"
"""Service that clients of the planning action call to send a goal."""


def is_planner_present(node: Node) -> bool:
    """Return whether a node provides the move_action action in the namespace of the given node."""
    return node.resolve_service_name(PLANNER_SERVICE) in {name for name, _ in node.get_service_names_and_types()}
