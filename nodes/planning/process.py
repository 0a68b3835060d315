"""Run the move_group process until a signal arrives or another move_group appears."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from nodes.only_one import Search
from nodes.planning.move_group import NAME, MoveGroupNode
from nodes.planning.routes import Route
from nodes.ros_process import exit_watchdog, init_rclpy, rcl_errors, spin_until_stopped
from nodes.stop_signals import ARM_CONTINUES, on_stop_signal
from planning.robot import PlanningRobot

OTHER: Final = (
    "another node is named {}, so MoveIt or another servoloop plan-server is running. "
    "Stop that program first, because both programs would move the arm"
)
"""Message to show if the ROS graph contains another server. The name of that server replaces the braces."""


@dataclass(frozen=True, slots=True)
class ServerSettings:
    """Settings of the process that do not concern the robot."""

    namespace: str = ""
    """Namespace of the node and of the stack, or empty for the root namespace."""
    sim_time: bool = False
    """Whether the stack runs in simulated time."""


def run(robot: PlanningRobot, routes: tuple[Route, ...], ready: Callable[[], None], settings: ServerSettings) -> int:
    """Serve MoveIt's interfaces until SIGINT, SIGTERM or SIGHUP.

    Args:
        robot: The robot.
        routes: Controllers of the stack and their joints.
        ready: Function to call when clients can send requests.
        settings: Other settings.

    Returns:
        The exit status.

    Raises:
        RosError: ROS 2 cannot start, or another move_group is running.
    """
    Search(NAME, settings.namespace, OTHER).finish()
    reach = init_rclpy(namespace=settings.namespace)
    try:
        with rcl_errors():
            node = Node(NAME, parameter_overrides=[Parameter("use_sim_time", value=settings.sim_time)])
        node.get_logger().info(reach)
        return _serve(node, robot, routes, ready)
    finally:
        with exit_watchdog():
            rclpy.try_shutdown()


def _serve(node: Node, robot: PlanningRobot, routes: tuple[Route, ...], ready: Callable[[], None]) -> int:
    executor, stopped, failures = SingleThreadedExecutor(), Future(), list[str]()
    executor.add_node(node)

    async def stop(reason: str) -> None:
        await server.stop(reason)
        if not stopped.done():
            stopped.set_result(None)

    def on_other() -> None:
        if not failures:
            failures.append(OTHER.format(node.get_fully_qualified_name()))
            node.get_logger().fatal(failures[0])
            executor.create_task(stop, failures[0])

    server = MoveGroupNode(node, robot, routes, on_other)
    on_stop_signal(lambda: executor.create_task(stop, "the planning server is shutting down"), ARM_CONTINUES)
    try:
        ready()
        spin_until_stopped(
            executor, stopped, lambda: stop("the planning server is shutting down because of an internal error")
        )
    finally:
        with exit_watchdog():
            executor.shutdown(timeout_sec=1.0)
            node.destroy_node()
    return 1 if failures else 0
