"""Run the process of the node ``vision_pick_place_controller``, from its arguments to its exit status."""

import argparse
import os
from collections.abc import Sequence

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from drivers.printable import printable, printable_line
from nodes.discovery import open_to_network
from nodes.pick_place import parameters
from nodes.pick_place.node import PickPlaceNode
from nodes.ros_process import exit_watchdog, init_rclpy, rcl_errors, spin_until_done
from nodes.stop_signals import on_stop_signal

NODE_NAME = "vision_pick_place_controller"


def _options(args: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        NODE_NAME, description="Sort apples with the arm. ROS arguments follow --ros-args."
    )
    parser.add_argument("--network", action="store_true", help="let programs on other machines send goals")
    return parser.parse_known_args(remove_ros_args(args)[1:])[0]


def run(args: Sequence[str]) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP.

    Args:
        args: Arguments in the form of ``sys.argv``.

    Returns:
        The exit status.

    Raises:
        RosError: ROS 2 does not start.
    """
    with rcl_errors():
        options = _options(args)
    if options.network:
        open_to_network(os.environ)
    reach = init_rclpy(args)
    executor = SingleThreadedExecutor()
    stopped = Future()

    async def stop() -> None:
        await controller.stop()
        stopped.set_result(None)

    on_stop_signal(lambda: executor.create_task(stop))
    with rcl_errors():
        node = rclpy.create_node(NODE_NAME, automatically_declare_parameters_from_overrides=True)
    node.get_logger().info(reach)
    executor.add_node(node)
    try:
        given = parameters.undeclare_overrides(node)
        controller = PickPlaceNode(node)
        for warning in parameters.unused(node, given, args):
            node.get_logger().warning(printable_line(warning))
        spin_until_done(executor, stopped)
    except (ValueError, ParameterException, NameValidationException) as error:
        node.get_logger().fatal(printable(f"invalid parameters: {error}"))
        return 2
    finally:
        with exit_watchdog():
            executor.shutdown()
            node.destroy_node()
            rclpy.shutdown()
    return 0
