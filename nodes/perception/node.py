"""Publish the camera images and the apples in them.

A thread reads the camera, grades the apples and publishes the results. The executor serves the parameters and publishes
``/diagnostics``.
"""

import threading
from collections.abc import Callable
from time import time
from typing import Any, Final

import rclpy
from apple_quality_msgs.msg import AppleQualityArray
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time as RosTimePoint
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from drivers.clock import Clock, wall_offset_s
from drivers.printable import printable
from nodes.namespace import frame_prefix, namespace_of
from nodes.perception.messages import apple_array, camera_info, compressed, diagnostics, image, pose_array
from nodes.perception.parameters import FRAMES, Setup, declare
from perception.grading.annotate import annotated
from perception.grading_loop import GradingLoop, GradingStatus, Seen
from perception.intrinsics import Intrinsics
from perception.perception_errors import PerceptionError

APPLES: Final = "sorting/perception/apple_quality"
POSES: Final = "sorting/perception/apple_poses"
READ_S: Final = 1.0
"""Maximum time to wait for a frame, in seconds."""
JOIN_S: Final = 5.0
"""Maximum time to wait for the thread at shutdown, in seconds."""


class CameraNode:
    """ROS interface of one camera."""

    def __init__(self, node: Node, setup: Setup, clock: Clock) -> None:
        self._node, self._clock = node, clock
        namespace = namespace_of(node)
        prefix = frame_prefix(namespace)
        self._title = f"{namespace}/{node.get_name()}: grading" if namespace else f"{node.get_name()}: grading"
        """Name of the diagnostic status."""
        frames = {name: (prefix + frame, description) for name, (frame, description) in FRAMES.items()}
        self._camera_frame, self._base_frame = map(str, declare(node, frames).values())
        self._images = node.create_publisher(Image, "~/image_raw", qos_profile_sensor_data)
        self._compressed = node.create_publisher(CompressedImage, "~/image_raw/compressed", qos_profile_sensor_data)
        self._infos = node.create_publisher(CameraInfo, "~/camera_info", qos_profile_sensor_data)
        self._annotated = node.create_publisher(Image, "~/image_annotated", qos_profile_sensor_data)
        self._apples = node.create_publisher(AppleQualityArray, APPLES, 10)
        self._poses = node.create_publisher(PoseArray, POSES, 10)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._status = GradingStatus(False, "the camera is not open yet")
        self._logged = ""
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._start(setup)
        node.create_timer(1.0, self._report)

    def stop(self) -> None:
        """Stop the thread and release the camera."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(JOIN_S)

    def _start(self, setup: Setup) -> None:
        try:
            camera = setup(self._node)
        except PerceptionError as error:
            self._set(GradingStatus(False, str(error)))
            return
        loop = GradingLoop(camera.source, camera.grading, self._clock)
        arguments = (loop, camera.intrinsics)
        self._thread = threading.Thread(target=self._run, args=arguments, name="camera", daemon=True)
        self._thread.start()

    def _run(self, loop: GradingLoop, intrinsics: Intrinsics) -> None:
        try:
            while not self._stop.is_set():
                seen = loop.step(READ_S)
                self._set(loop.status)
                if seen is not None and rclpy.ok():
                    self._publish(seen, intrinsics)
        except Exception as error:  # The node must report that it no longer grades images.
            self._set(GradingStatus(False, f"internal error: {type(error).__name__}: {error}"))
            self._node.get_logger().error(printable(f"the camera has stopped: {type(error).__name__}: {error}"))
        finally:
            loop.close()

    def _publish(self, seen: Seen, intrinsics: Intrinsics) -> None:
        rgb, stamp = seen.frame.rgb, self._stamp(seen.frame.stamp_s)
        header = Header(stamp=stamp, frame_id=self._camera_frame)
        if seen.apples is not None:  # The apples are published first, because the arm is waiting for them.
            self._apples.publish(apple_array(seen.apples, header))
            self._poses.publish(pose_array(seen.apples, Header(stamp=stamp, frame_id=self._base_frame)))
        self._infos.publish(camera_info(intrinsics, header))
        _if_wanted(self._images, lambda: image(rgb, header))
        _if_wanted(self._compressed, lambda: compressed(rgb, header))
        _if_wanted(self._annotated, lambda: image(annotated(rgb, seen.apples or ()), header))

    def _stamp(self, stamp_s: float) -> Time:
        """Convert a capture time on the camera's clock to ROS time."""
        return RosTimePoint(nanoseconds=round((stamp_s + wall_offset_s(self._clock, time)) * 1e9)).to_msg()

    def _set(self, status: GradingStatus) -> None:
        """Store the status, and log when a failure begins or ends."""
        self._status = status
        problem = "" if status.working else status.message
        if problem == self._logged:
            return
        self._logged = problem
        if problem:  # rclpy accepts only one severity per call site.
            self._node.get_logger().error(printable(f"no images are graded: {problem}"))
        else:
            self._node.get_logger().info("the camera works, and its images are being graded")

    def _report(self) -> None:
        now = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(diagnostics(self._title, self._status, now))


def _if_wanted(publisher: Publisher, message: Callable[[], Any]) -> None:
    """Publish a message only if the topic has a subscriber, because images are large."""
    if publisher.get_subscription_count() > 0:
        publisher.publish(message())
