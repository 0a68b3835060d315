"""The node ``vision_pick_place_controller``: picks the apple and puts it into the bin of its grade.

``python -m nodes.vision_pick_place_controller [--network] --ros-args …``; what it does is in pick_place/.
"""

import argparse
import os
import sys
from collections.abc import Sequence

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from drivers.errors import DriverError
from nodes.discovery import open_to_network
from nodes.pick_place.node import PickPlaceNode
from nodes.pick_place.signals import on_stop_signal
from nodes.ros_process import exit_watchdog, init_rclpy, spin_until_done

NODE_NAME = "vision_pick_place_controller"


def _options(args: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(NODE_NAME, description="Sorts apples with the arm. ROS arguments: --ros-args …")
    parser.add_argument("--network", action="store_true", help="let programs on other machines send goals, too")
    return parser.parse_known_args(remove_ros_args(args)[1:])[0]


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP; the exit status. ``args`` as in ``sys.argv``."""
    args = sys.argv if args is None else args
    if _options(args).network:
        open_to_network(os.environ)
    try:
        reach = init_rclpy(args)
    except DriverError as error:
        print(f"{NODE_NAME}: {error}", file=sys.stderr)
        return 2
    executor = SingleThreadedExecutor()
    stopped = Future()

    async def stop() -> None:
        await controller.stop()
        stopped.set_result(None)

    on_stop_signal(lambda: executor.create_task(stop))
    node = rclpy.create_node(NODE_NAME)
    node.get_logger().info(reach)
    executor.add_node(node)
    try:
        controller = PickPlaceNode(node)
        spin_until_done(executor, stopped)
    except (ValueError, ParameterException, NameValidationException) as error:
        node.get_logger().fatal(f"wrong parameters: {error}")
        return 2
    finally:
        with exit_watchdog():
            executor.shutdown()
            node.destroy_node()
            rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
