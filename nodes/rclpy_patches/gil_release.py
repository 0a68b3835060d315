"""Release the GIL while the middleware sends and takes messages. Supports rclpy 7.1.5.

rclpy holds the GIL during these calls, although DDS can block a call that sends a message. DDS waits for its own locks
while clients connect and disconnect (0.4 s on two cores for 50 clients that start together). rmw_fastrtps also waits up
to 0.1 s in each response to a client whose reader is still undiscovered or incompatible. Without this patch, no Python
code can run during these waits, so the control loop stops as well.

The functions of rcl_calls.py replace twelve methods of rclpy and call the same C functions through ctypes. Messages
that are too large or too frequent are not converted to Python (see client_limits.py).
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
"""Signatures of the replaced C methods, keyed by class, as pybind11 documents them."""
_SEND_RESPONSE: Final = ("self", "response", "header")
"""Parameters of ``Service.send_response``, the only replaced method that is written in Python."""
_FIELDS: Final = {
    "rmw_service_info_t": ("source_timestamp", "received_timestamp", "request_id"),
    "rmw_request_id_t": ("sequence_number",),
}
"""rclpy's names for the fields of the structures whose layouts rcl_calls.py defines."""


def replacements() -> list[tuple[Any, str, Any]]:
    """Return the owner, name and replacement of each replaced method."""
    from nodes.rclpy_patches import rcl_calls  # This import opens the C libraries.

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
    """Replace the rclpy methods in the whole process."""
    for owner, name, function in replacements():
        setattr(owner, name, function)


def send_delayed() -> None:
    """Send the rejections and statuses that were delayed by a flood of goals. This function must be called often if the
    patch is in use."""
    from nodes.rclpy_patches import rcl_calls

    rcl_calls.send_refusals()
    rcl_calls.publish_waiting_statuses()


def _differences() -> Iterable[str]:
    yield from _other_methods()
    replacements()  # This import fails if a C library or one of its functions is missing.
    yield from _other_layouts()


def _other_methods() -> Iterable[str]:
    for owner, methods in _SIGNATURES.items():
        for name, expected in methods.items():
            method = getattr(getattr(rclpy_implementation, owner, None), name, None)
            found = (getattr(method, "__doc__", "") or "").partition("\n")[0].removeprefix(name)
            if found != expected:
                yield f"{owner}.{name} is {found or 'missing'} instead of {expected}"
    if tuple(inspect.signature(Service.send_response).parameters) != _SEND_RESPONSE:
        yield f"Service.send_response has parameters different from {', '.join(_SEND_RESPONSE)}"


def _other_layouts() -> Iterable[str]:
    from nodes.rclpy_patches import rcl_calls
    from nodes.rclpy_patches.message_size import layout_of

    for name, fields in _FIELDS.items():
        yield from missing(getattr(rclpy_implementation, name), fields)
    layout_of(FollowJointTrajectory.Impl.SendGoalService.Request)  # This call fails if the layout differs.
    ours = ctypes.sizeof(rcl_calls.GoalStatuses)
    if platform.machine() == "x86_64" and (theirs := rcl_calls.written_by_zero_initialized_goal_statuses()) != ours:
        yield f"rcl_action_goal_status_array_t has {theirs} bytes instead of {ours}"


PATCH: Final = Patch(
    "gil_release",
    RCLPY_7_1_5,
    "a client that leaves or has an incompatible QoS can block the control loop for 0.1 s, and a client that sends a "
    "message of many megabytes can block it for a second (max_message_size has no effect)",
    _differences,
)
