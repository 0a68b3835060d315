"""rclpy with the interpreter's lock (GIL) left to others while the middleware sends and takes. Known for rclpy 7.1.5.

rclpy holds it. But DDS can keep a sender waiting: for its own locks while clients come and go (50 that start at once:
0.4 s on two cores), and up to 0.1 s in each answer to a client whose ear is not known yet or fits no answer of ours
(rmw_fastrtps waits for it). Meanwhile no Python ran in this process: no control cycle either. The functions of
rcl_calls.py stand in for twelve methods of rclpy; they call the same C functions through ctypes. What they take is not
turned into Python if a client may not send it, for its size or because it sends too often (client_limits.py).
"""

import ctypes
import inspect
import platform
from collections.abc import Iterable
from typing import Any, Final

from control_msgs.action import FollowJointTrajectory
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.service import Service

from nodes.rclpy_patches.patch import RCLPY_7_1_5, Patch, missing

_C: Final = "rclpy._rclpy_pybind11"
_REQUESTS: Final = ("goal", "cancel", "result")
_SIGNATURES: Final = {
    "Publisher": {"publish": f"(self: {_C}.Publisher, arg0: object) -> None"},
    "Subscription": {"take_message": f"(self: {_C}.Subscription, arg0: object, arg1: bool) -> object"},
    "Service": {"service_take_request": f"(self: {_C}.Service, arg0: object) -> tuple"},
    "ActionServer": {
        **{f"take_{name}_request": f"(self: {_C}.ActionServer, arg0: object) -> tuple" for name in _REQUESTS},
        **{
            f"send_{name}_response": f"(self: {_C}.ActionServer, arg0: {_C}.rmw_request_id_t, arg1: object) -> None"
            for name in _REQUESTS
        },
        "publish_feedback": f"(self: {_C}.ActionServer, arg0: object) -> None",
        "publish_status": f"(self: {_C}.ActionServer) -> None",
    },
}
"""The signatures of the replaced C methods by class, as pybind11 documents them."""
_ANSWER: Final = ("self", "response", "header")
"""The parameters of the one replaced method in Python, ``Service.send_response``."""
_FIELDS: Final = {
    "rmw_service_info_t": ("source_timestamp", "received_timestamp", "request_id"),
    "rmw_request_id_t": ("sequence_number",),
}
"""rclpy's own names for fields of the structures whose layouts are written down in rcl_calls.py."""


def replacements() -> list[tuple[Any, str, Any]]:
    """Owner, name and replacement of each replaced method."""
    from nodes.rclpy_patches import rcl_calls  # opens the C libraries

    server = rclpy_implementation.ActionServer
    return [
        (rclpy_implementation.Publisher, "publish", rcl_calls.publisher_publish),
        (rclpy_implementation.Subscription, "take_message", rcl_calls.subscription_take),
        (rclpy_implementation.Service, "service_take_request", rcl_calls.service_take_request),
        (Service, "send_response", rcl_calls.service_send_response),
        *((server, f"take_{name}_request", rcl_calls.server_take(name)) for name in _REQUESTS),
        *((server, f"send_{name}_response", rcl_calls.server_send(name)) for name in _REQUESTS),
        (server, "publish_feedback", rcl_calls.server_publish_feedback),
        (server, "publish_status", rcl_calls.server_publish_status),
    ]


def release_gil_in_middleware() -> None:
    """Replace the methods, from now on and in this whole process."""
    for owner, name, function in replacements():
        setattr(owner, name, function)


def send_what_waits() -> None:
    """Send what a flood of goals has put off. To be called often, where the methods are replaced."""
    from nodes.rclpy_patches import rcl_calls

    rcl_calls.send_refusals()
    rcl_calls.publish_waiting_statuses()


def _differences() -> Iterable[str]:
    yield from _other_methods()
    replacements()  # raises where a C library or one of its functions is not there
    yield from _other_layouts()


def _other_methods() -> Iterable[str]:
    for owner, methods in _SIGNATURES.items():
        for name, expected in methods.items():
            method = getattr(getattr(rclpy_implementation, owner, None), name, None)
            found = (getattr(method, "__doc__", "") or "").partition("\n")[0].removeprefix(name)
            if found != expected:
                yield f"{owner}.{name} is {found or 'missing'} and not {expected}"
    if tuple(inspect.signature(Service.send_response).parameters) != _ANSWER:
        yield f"Service.send_response has other parameters than {', '.join(_ANSWER)}"


def _other_layouts() -> Iterable[str]:
    from nodes.rclpy_patches import rcl_calls
    from nodes.rclpy_patches.message_size import layout_of

    for name, fields in _FIELDS.items():
        yield from missing(getattr(rclpy_implementation, name), fields)
    layout_of(FollowJointTrajectory.Impl.SendGoalService.Request)  # raises where the layout of messages is another one
    ours = ctypes.sizeof(rcl_calls.GoalStatuses)
    if platform.machine() == "x86_64" and (theirs := rcl_calls.written_by_zero_initialized_goal_statuses()) != ours:
        yield f"rcl_action_goal_status_array_t has {theirs} bytes and not {ours}"


PATCH: Final = Patch(
    "gil_release",
    RCLPY_7_1_5,
    "a client that leaves, or listens with other qualities of service, can hold up the control loop for 0.1 s, and one "
    "that sends a message of many megabytes for a second (max_message_size has no effect)",
    _differences,
)
