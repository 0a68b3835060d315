"""The service ``~/get_type_description``, which rclpy (7.1) leaves on the graph when its node goes."""

import ctypes

from rclpy.node import Node

NAME = "/get_type_description"

_finish = ctypes.CDLL("librcl.so").rcl_service_fini
_finish.argtypes = (ctypes.c_void_p, ctypes.c_void_p)
_finish.restype = ctypes.c_int


def take_off_type_service(node: Node) -> None:
    """For a node that is about to be destroyed: in rclpy nothing ends the service beneath its own, so this does."""
    for service in node.services:
        if service.srv_name.endswith(NAME):
            with service.handle, node.handle:
                _finish(service.handle.pointer, node.handle.pointer)
