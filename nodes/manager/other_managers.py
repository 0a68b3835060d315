"""Discover other controller managers with the name of an own one while a stack runs."""

from typing import Final

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from controller.diagnostics import Level, Status
from nodes.only_one import CHECK_S, Discovery, Seniority, nodes_in_graph

MANAGER: Final = "controller_manager"
"""Name of the node of the controller manager."""
OTHER: Final = (
    "another node is named {}, so a client's goal would move the arms of both stacks: end the other stack, or choose "
    "another --namespace or another ROS_DOMAIN_ID for this one"
)
"""Message if another controller manager with the name in the braces is in the ROS graph."""
STATUS: Final = "servoloop: other controller managers"
"""Name of the diagnostic status that reports another controller manager."""


class OtherManagers:
    """Check once per second whether there is another controller manager with the name of this one.

    A new stack ends when it discovers another one. An old stack, whose arm may be in motion, only reports it.
    """

    def __init__(self, node: Node) -> None:
        self.must_end = False
        """Whether this stack must end, because it is the newer one."""
        self.message = OTHER.format(node.get_fully_qualified_name())
        self._node = node
        self._seniority = Seniority()
        self._reported = False
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # The clock of the node may be simulated.
        node.create_timer(CHECK_S, self._check, clock=steady)

    def status(self, hardware_id: str) -> Status:
        """Return the diagnostic status."""
        level, message = (Level.WARN, self.message) if self._reported else (Level.OK, "none")
        return Status(level, STATUS, message, hardware_id)

    def _check(self) -> None:
        finding = self._seniority.check(nodes_in_graph(self._node, MANAGER))
        self.must_end = self.must_end or finding is Discovery.NEWCOMER
        if finding is Discovery.RIVAL and not self._reported:
            self._node.get_logger().warning(self.message)
        self._reported = finding is Discovery.RIVAL
