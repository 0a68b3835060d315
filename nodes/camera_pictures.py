"""Receive the compressed pictures of the camera node as they are encoded, for recordings."""

import struct
from collections.abc import Callable
from typing import Final

from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage

PICTURES: Final = "apple_camera/image_raw/compressed"
"""Topic of the compressed pictures."""
STAMP: Final = struct.Struct("<iI")
"""Layout of the stamp, seconds and nanoseconds, which is the first field of the message."""
STAMP_AT: Final = 4
"""Position of the stamp after the header of the encoding, in bytes."""


def subscribe_pictures(node: Node, store: Callable[[int, bytes], None]) -> None:
    """Pass the stamp (in ns of ROS time) and the encoded message of every picture to ``store``."""

    def on_message(data: bytes) -> None:
        seconds, nanoseconds = STAMP.unpack_from(data, STAMP_AT)
        store(1_000_000_000 * seconds + nanoseconds, bytes(data))

    node.create_subscription(CompressedImage, PICTURES, on_message, qos_profile_sensor_data, raw=True)
