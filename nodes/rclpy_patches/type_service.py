"""The service ``~/get_type_description``, which rclpy leaves on the graph when its node goes.

Known for rclpy 7.1.5. Nothing in it ends the service beneath its own one, so this calls rcl for it.
"""

import ctypes
from typing import Any, Final

from rclpy.node import Node

from nodes.rclpy_patches.patch import RCLPY_7_1_5, Patch

NAME: Final = "/get_type_description"


def remove_type_service(node: Node) -> None:
    """Take it off the graph, for a node that is about to be destroyed."""
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
    "the service get_type_description of an unloaded controller stays in the lists of services",
    _differences,
)
