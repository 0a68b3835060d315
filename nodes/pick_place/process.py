"""Run the process of the ``vision_pick_place_controller`` node, from its arguments to its exit status."""

from collections.abc import Sequence

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future

from drivers.printable import printable, printable_line
from nodes.overrides import undeclare_overrides, unused
from nodes.pick_place.node import PickPlaceNode
from nodes.ros_process import exit_watchdog, init_rclpy, rcl_errors, read_network_option, spin_until_stopped
from nodes.stop_signals import ARM_CONTINUES, on_stop_signal

NODE_NAME = "vision_pick_place_controller"


def run(args: Sequence[str]) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP.

    Args:
        args: Arguments in the form of ``sys.argv``.

    Returns:
        The exit status.

    Raises:
        RosError: ROS 2 does not start.
    """
    network = "let programs on other machines send goals"
    read_network_option(args, NODE_NAME, "Sort apples with the arm.", network)
    reach = init_rclpy(args)
    executor = SingleThreadedExecutor()
    stopped = Future()

    async def stop() -> None:
        await controller.stop()
        stopped.set_result(None)

    on_stop_signal(lambda: executor.create_task(stop), ARM_CONTINUES)
    with rcl_errors():
        node = rclpy.create_node(NODE_NAME, automatically_declare_parameters_from_overrides=True)
    node.get_logger().info(reach)
    executor.add_node(node)
    try:
        given = undeclare_overrides(node)
        controller = PickPlaceNode(node)
    except (ValueError, ParameterException, NameValidationException) as error:
        node.get_logger().fatal(printable(f"invalid parameters: {error}"))
        return 2
    else:
        for warning in unused(node, given, args):
            node.get_logger().warning(printable_line(warning))
        spin_until_stopped(executor, stopped, stop)
    finally:
        with exit_watchdog():
            executor.shutdown()
            node.destroy_node()
            rclpy.shutdown()
    return 0
