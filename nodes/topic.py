"""A publisher that does not hold the interpreter's lock while the middleware works.

rclpy's own does. While clients come and go, DDS can keep a publication waiting for its locks for some tenths of a
second (50 clients that start at once: 0.4 s on two cores), and meanwhile no Python runs in this process: no control
cycle either. Called through ctypes, the same C function (rcl_publish_serialized_message of rcl/publisher.h) leaves
the lock to others.
"""

import ctypes
from typing import Any, Generic, TypeVar

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

Message = TypeVar("Message")


class _SerializedMessage(ctypes.Structure):
    """rcutils_uint8_array_t of rcutils/types/uint8_array.h; its allocator's five pointers are not used to publish."""

    _fields_ = (
        ("buffer", ctypes.c_char_p),
        ("buffer_length", ctypes.c_size_t),
        ("buffer_capacity", ctypes.c_size_t),
        ("allocator", ctypes.c_void_p * 5),
    )


_publish = ctypes.CDLL("librcl.so").rcl_publish_serialized_message
_publish.argtypes = (ctypes.c_void_p, ctypes.POINTER(_SerializedMessage), ctypes.c_void_p)
_publish.restype = ctypes.c_int


class Topic(Generic[Message]):
    """One topic of one node."""

    def __init__(self, node: Node, kind: type[Message], name: str, qos: QoSProfile | int = 10) -> None:
        self._publisher: Any = node.create_publisher(kind, name, qos)
        self._kind = kind

    @property
    def listeners(self) -> int:
        """How many subscribers there are."""
        return int(self._publisher.get_subscription_count())

    def publish(self, message: Message) -> None:
        """Send it. Raises TypeError for another kind of message, RuntimeError once ROS is shut down."""
        if not isinstance(message, self._kind):
            raise TypeError(f"{self._publisher.topic_name} takes {self._kind.__name__}, not {type(message).__name__}")
        data = serialize_message(message)
        with self._publisher.handle:
            code = _publish(self._publisher.handle.pointer, _SerializedMessage(data, len(data), len(data)), None)
        if code:
            raise RuntimeError(f"could not publish on {self._publisher.topic_name}: rcl says {code}")
