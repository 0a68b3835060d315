"""Let only one node move_group run: two would move the same arm."""

from time import monotonic
from typing import Final

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from nodes.namespace import namespace_of
from nodes.ros_environment import RosError
from nodes.ros_process import rcl_errors

NAME: Final = "move_group"
"""Name of the node, to which MoveIt's clients connect."""
DISCOVERY_S: Final = 2.0
"""Time to discover other nodes before the start, in seconds."""
CHECK_S: Final = 1.0
"""Period of the search for other nodes while the server runs, in seconds."""
NEW_CHECKS: Final = 5
"""Checks after the start during which a server ends as soon as it discovers another one."""
PATIENT_CHECKS: Final = 6
"""Checks in a row that must discover another server before one that has run for longer ends, too."""
OTHER: Final = (
    "another node is named {}: a MoveIt or another servoloop plan-server is running; "
    "end it first, because both would move the arm"
)
"""Message if another server with the name in the braces is in the ROS graph."""


class Seniority:
    """Decides which of two servers ends: the newer one, even if it discovers the older one late.

    DDS discovers nodes late on a loaded machine, so a second server can start. A new server ends at once
    when it discovers the other one. An old server gives it time to do so.
    """

    def __init__(self) -> None:
        self._checks = 0
        self._in_a_row = 0

    def must_end(self, servers: int) -> bool:
        """Count one check, and return whether this server must end.

        Args:
            servers: Number of servers in the ROS graph, including this one.
        """
        self._checks += 1
        self._in_a_row = self._in_a_row + 1 if servers > 1 else 0
        return self._in_a_row >= (1 if self._checks <= NEW_CHECKS else PATIENT_CHECKS)


def servers_in_graph(node: Node) -> int:
    """Return the number of nodes named move_group in the namespace of this node."""
    own = (NAME, node.get_namespace())
    return sum(found == own for found in node.get_node_names_and_namespaces())


def check_alone() -> None:
    """Search for another move_group before this one starts.

    Raises:
        RosError: Another move_group is in the ROS graph.
    """
    with rcl_errors():
        probe = Node("servoloop_plan_server")
    end_s = monotonic() + DISCOVERY_S
    executor = SingleThreadedExecutor()
    executor.add_node(probe)
    try:
        while monotonic() < end_s:
            executor.spin_once(timeout_sec=0.1)
            if servers_in_graph(probe):
                raise RosError(OTHER.format(f"{namespace_of(probe)}/{NAME}"))
    finally:
        executor.shutdown(timeout_sec=1.0)
        probe.destroy_node()
