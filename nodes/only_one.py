"""Detect nodes of other programs that have the same name as a node of this program, so that two programs do not move
the same arm."""

import os
import time
from enum import Enum, auto
from typing import Any, Final

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from controller.diagnostics import Level, Status
from nodes.discovery import stay_on_this_machine
from nodes.namespace import namespace_arguments
from nodes.ros_environment import RosError
from nodes.ros_process import exit_watchdog, rcl_errors

DISCOVERY_S: Final = 0.8
"""Time to discover other nodes before startup, in seconds.

On an idle machine, discovery took 0.1 to 0.7 s, because a program often misses the first response and waits for the
next announcement.
"""
PATIENT_DISCOVERY_S: Final = 2.5
"""Time to discover other nodes if another node is likely to be missed, in seconds.

With a Fast DDS discovery server on the same machine, discovery took 0.9 to 1.2 s.
"""
POLL_S: Final = 0.02
CHECK_S: Final = 1.0
"""Period of the search for other nodes while a node runs, in seconds."""
NEW_CHECKS: Final = 5
"""Number of checks after startup during which a node counts as new."""
PATIENT_CHECKS: Final = 6
"""Number of consecutive checks that must discover another node before a longer-running node reports it."""

STATUS: Final = "servoloop: other stacks"
"""Name of the diagnostic status that reports another node with the same name."""


class Discovery(Enum):
    """Result of one check."""

    ALONE = auto()
    """There is no other node, or the other node has not been visible for long enough."""
    NEWCOMER = auto()
    """There is another node, and this node is new."""
    RIVAL = auto()
    """There is another node, and this node has been running longer."""


class Seniority:
    """Check that determines which of two nodes is newer, even if this node discovers the older node late.

    DDS discovers nodes late on a loaded machine, so a second node can start. A new node reports another node
    immediately. An older node gives the newer node time to exit.
    """

    def __init__(self) -> None:
        self._checks = 0
        self._in_a_row = 0

    def check(self, nodes: int) -> Discovery:
        """Count one check and return its result.

        Args:
            nodes: Number of nodes with this name in the ROS graph, including this program's node.
        """
        self._checks += 1
        self._in_a_row = self._in_a_row + 1 if nodes > 1 else 0
        if self._checks <= NEW_CHECKS:
            return Discovery.NEWCOMER if self._in_a_row else Discovery.ALONE
        return Discovery.RIVAL if self._in_a_row >= PATIENT_CHECKS else Discovery.ALONE


def nodes_in_graph(node: Node, name: str) -> int:
    """Return the number of nodes with a given name in the namespace of ``node``."""
    wanted = (name, node.get_namespace())
    return sum(found == wanted for found in node.get_node_names_and_namespaces())


class OtherNodes:
    """Periodic check, once per second, for another node with the same name as a node of this program.

    A new stack exits when it discovers another stack. A longer-running stack, whose arm may be in motion, only reports
    the other stack.
    """

    def __init__(self, node: Node, message: str) -> None:
        """Start checking. The braces in ``message`` are replaced by the full name of the node."""
        self.must_end = False
        """Whether this stack must exit because it is the newer stack."""
        self.message = message.format(node.get_fully_qualified_name())
        self._node = node
        self._seniority = Seniority()
        self._reported = False
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # The node's clock may be simulated.
        node.create_timer(CHECK_S, self._check, clock=steady)

    def status(self, hardware_id: str) -> Status:
        """Return the diagnostic status."""
        level, message = (Level.WARN, self.message) if self._reported else (Level.OK, "none")
        return Status(level, STATUS, message, hardware_id)

    def require_none(self) -> None:
        """Raise RosError if this stack must exit."""
        if self.must_end:
            raise RosError(self.message)

    def _check(self) -> None:
        finding = self._seniority.check(nodes_in_graph(self._node, self._node.get_name()))
        self.must_end = self.must_end or finding is Discovery.NEWCOMER
        if finding is Discovery.RIVAL and not self._reported:
            self._node.get_logger().warning(self.message)
        self._reported = finding is Discovery.RIVAL


class Search:
    """Search for another program's node before this program creates a node with the same name.

    The search uses its own ROS context, because a new context discovers only running programs. A program that was
    killed remains in the graphs of other programs for up to 20 s, but no longer announces itself.
    """

    def __init__(self, name: str, namespace: str, message: str, patient: bool = False) -> None:
        """Start discovering other nodes. Raises RosError if ROS 2 does not start.

        Args:
            name: Name of the node.
            namespace: Namespace of the node; empty for the root namespace.
            message: Error message to use if there is such a node. The braces are replaced by the node's full name.
            patient: Whether to wait longer because such a node is likely to exist.
        """
        self._name = name
        self._message = message.format(f"{namespace}/{name}")
        stay_on_this_machine(os.environ)
        self._context: Any = rclpy.Context()
        with rcl_errors():
            self._context.init(namespace_arguments(namespace), initialize_logging=False)
            self._node: Node | None = Node(
                f"_servoloop_search_{os.getpid()}",  # The underscore hides the node from node lists.
                context=self._context,
                enable_rosout=False,
                start_parameter_services=False,
            )
        patient = patient or bool(os.environ.get("ROS_DISCOVERY_SERVER"))
        self._end_s = time.monotonic() + (PATIENT_DISCOVERY_S if patient else DISCOVERY_S)

    def finish(self) -> None:
        """Wait until the discovery time has passed since the search started, and leave the ROS graph.

        Raises:
            RosError: Another node has this name.
        """
        try:
            while not self._found():
                if time.monotonic() >= self._end_s:
                    return
                time.sleep(POLL_S)
            raise RosError(self._message)
        finally:
            self.close()

    def close(self) -> None:
        """Leave the ROS graph."""
        if self._node is not None:
            with exit_watchdog():
                self._node.destroy_node()
                self._context.try_shutdown()
            self._node = None

    def __enter__(self) -> "Search":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _found(self) -> bool:
        return self._node is not None and nodes_in_graph(self._node, self._name) > 0
