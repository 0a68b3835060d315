"""Receive the compressed images of the camera node without decoding them, for recordings and for the browser view."""

import struct
from collections.abc import Callable
from typing import Final

from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage

from drivers.clock import Clock
from nodes.clients.client_node import WatchingNode

PICTURES: Final = "apple_camera/image_raw/compressed"
"""Topic of the compressed images."""
GONE_S: Final = 3.0
"""Maximum age at which an image is still shown, in seconds."""
STAMP: Final = struct.Struct("<iI")
"""Layout of the stamp (seconds and nanoseconds), which is the first field of the message."""
STAMP_AT: Final = 4
"""Position of the stamp after the encoding header, in bytes."""


def subscribe_pictures(node: Node, store: Callable[[int, bytes], None]) -> None:
    """Pass the stamp (in ns of ROS time) and the encoded message of every image to ``store``."""

    def on_message(data: bytes) -> None:
        seconds, nanoseconds = STAMP.unpack_from(data, STAMP_AT)
        store(1_000_000_000 * seconds + nanoseconds, bytes(data))

    node.create_subscription(CompressedImage, PICTURES, on_message, qos_profile_sensor_data, raw=True)


class PictureWatch:
    """Receiver of the latest image from the camera node, with its own thread and ROS context."""

    def __init__(self, clock: Clock, namespace: str = "") -> None:
        """Start watching the camera node in a namespace; empty for the root namespace."""
        self._clock = clock
        self._newest: CompressedImage | None = None
        self._received_s = 0.0
        self._watching = WatchingNode("servoloop_view_camera", namespace)
        self._watching.node.create_subscription(CompressedImage, PICTURES, self._on_picture, qos_profile_sensor_data)
        self._watching.start()

    @property
    def newest(self) -> CompressedImage | None:
        """Latest image; None if it is older than ``GONE_S``."""
        newest = self._newest
        return newest if self._clock.now() - self._received_s < GONE_S else None

    def close(self) -> None:
        """Stop watching."""
        self._watching.close()

    def _on_picture(self, message: CompressedImage) -> None:
        self._received_s, self._newest = self._clock.now(), message
