"""Run the process of the camera node, from its arguments to its exit status."""

from collections.abc import Sequence
from typing import Final

import cv2
import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future

from drivers.clock import MonotonicClock
from drivers.printable import printable, printable_line
from nodes.overrides import undeclare_overrides, unused
from nodes.perception.node import CameraNode
from nodes.perception.parameters import Setup, camera_of_parameters, given_camera
from nodes.ros_process import exit_watchdog, init_rclpy, rcl_errors, read_network_option, spin_until_done
from nodes.stop_signals import on_stop_signal
from perception.camera_view import CameraView
from perception.frames import CameraSource
from perception.grading.settings import GradingSettings
from perception.perception_errors import PerceptionError
from perception.sources.native_log import silence_native_log

NODE_NAME: Final = "apple_camera"


def run(args: Sequence[str]) -> int:
    """Run the node with the camera that its parameters select, until SIGINT, SIGTERM or SIGHUP.

    Args:
        args: Arguments in the form of ``sys.argv``.

    Returns:
        The exit status.

    Raises:
        RosError: ROS 2 does not start.
    """
    return _run(args, camera_of_parameters(MonotonicClock()))


def run_source(source: CameraSource, view: CameraView, settings: GradingSettings, args: Sequence[str]) -> int:
    """Run the node like ``run``, but with a given camera whose timestamps are monotonic clock times."""
    return _run(args, given_camera(source, view, settings))


def _run(args: Sequence[str], setup: Setup) -> int:
    network = "let programs on other machines receive the images"
    read_network_option(args, NODE_NAME, "Grade apples with a camera.", network)
    silence_native_log()
    cv2.setNumThreads(1)  # The other processors are left to the control loop.
    init_rclpy(args)
    executor, stopped = SingleThreadedExecutor(), Future()

    async def stop() -> None:
        stopped.set_result(None)

    on_stop_signal(lambda: executor.create_task(stop))
    with rcl_errors():
        node = rclpy.create_node(NODE_NAME, automatically_declare_parameters_from_overrides=True)
    executor.add_node(node)
    camera: CameraNode | None = None
    try:
        given = undeclare_overrides(node)
        camera = CameraNode(node, setup, MonotonicClock())
    except (ValueError, ParameterException, NameValidationException, PerceptionError) as error:
        node.get_logger().fatal(printable(f"invalid parameters: {error}"))
        return 2
    else:
        for warning in unused(node, given, args):
            node.get_logger().warning(printable_line(warning))
        spin_until_done(executor, stopped)
    finally:
        with exit_watchdog():
            if camera is not None:
                camera.stop()
            executor.shutdown()
            node.destroy_node()
            rclpy.shutdown()
    return 0
