"""Remove the service ``~/get_type_description``, which rclpy leaves in the graph when its node is destroyed.

Supports rclpy 7.1.5. rclpy has no method that destroys the rcl service, so this module calls rcl directly.
"""

import ctypes
from typing import Any, Final

from rclpy.node import Node

from nodes.rclpy_patches.patch import RCLPY_7_1_5, Patch

NAME: Final = "/get_type_description"


def remove_type_service(node: Node) -> None:
    """Remove the service of a node that is about to be destroyed."""
    finish = _rcl_service_fini()
    for service in node.services:
        if service.srv_name.endswith(NAME):
            with service.handle, node.handle:
                finish(service.handle.pointer, node.handle.pointer)


def _rcl_service_fini() -> Any:
    function = ctypes.CDLL("librcl.so").rcl_service_fini
    function.argtypes, function.restype = (ctypes.c_void_p, ctypes.c_void_p), ctypes.c_int
    return function


def _differences() -> list[str]:
    _rcl_service_fini()
    return []


PATCH: Final = Patch(
    "type_service",
    RCLPY_7_1_5,
    "the service get_type_description of an unloaded controller remains in the lists of services",
    _differences,
)
