"""rclpy with the interpreter's lock left to others while the middleware sends and takes.

rclpy (7.1) holds it. But DDS can keep a sender waiting: for its own locks while clients come and go (50 that start at
once: 0.4 s on two cores), and up to 0.1 s in each answer to a client whose ear is not known yet or fits no answer of
ours (rmw_fastrtps waits for it). Meanwhile no Python ran in this process: no control cycle either. The functions below
stand in for rclpy's own; they call the same C functions through ctypes, which leaves the lock to others. The layouts
are those of rmw/types.h and action_msgs/msg/detail/goal_status_array__struct.h.
"""

import ctypes
import logging
from collections.abc import Callable
from typing import Any, Final

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.service import Service

LOG = logging.getLogger("servoloop.nodes")

_TIMEOUT: Final = 2  # RCL_RET_TIMEOUT of rcl/types.h
_NOTHING_TAKEN: Final = (601, 2201)  # RCL_RET_SERVICE_TAKE_FAILED; RCL_RET_ACTION_SERVER_TAKE_FAILED

_RCL: Final = ctypes.CDLL("librcl.so")
_RCL_ACTION: Final = ctypes.CDLL("librcl_action.so")
_RCUTILS: Final = ctypes.CDLL("librcutils.so")


class _RequestId(ctypes.Structure):
    """rmw_request_id_t: whom an answer is for."""

    _fields_ = (("writer_guid", ctypes.c_uint8 * 16), ("sequence_number", ctypes.c_int64))


class _ServiceInfo(ctypes.Structure):
    """rmw_service_info_t."""

    _fields_ = (("sent_ns", ctypes.c_int64), ("received_ns", ctypes.c_int64), ("request_id", _RequestId))


class _GoalStatuses(ctypes.Structure):
    """rcl_action_goal_status_array_t: a sequence, and rcutils_allocator_t."""

    _fields_ = (("sequence", ctypes.c_void_p * 3), ("allocator", ctypes.c_void_p * 5))


class _ErrorText(ctypes.Structure):
    """rcutils_error_string_t."""

    _fields_ = (("text", ctypes.c_char * 1024),)


_RCUTILS.rcutils_get_error_string.restype = _ErrorText


class _Kind:
    """What a kind of message brings along to be turned into C and back. These do hold the interpreter's lock."""

    def __init__(self, kind: Any) -> None:
        self._create = ctypes.PYFUNCTYPE(ctypes.c_void_p)(_address(kind._CREATE_ROS_MESSAGE))
        self._destroy = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(_address(kind._DESTROY_ROS_MESSAGE))
        self._from_python = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, ctypes.c_void_p)(
            _address(kind._CONVERT_FROM_PY)
        )
        self._to_python = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)(_address(kind._CONVERT_TO_PY))

    def sent(self, message: Any, send: Callable[[int], int]) -> int:
        """What ``send`` returns for the message in C."""
        raw = self._create()
        try:
            self._from_python(message, raw)  # raises by itself
            return send(raw)
        finally:
            self._destroy(raw)

    def taken(self, take: Callable[[int], int]) -> tuple[int, Any]:
        """What ``take`` returns, and the message that it filled in."""
        raw = self._create()
        try:
            code = take(raw)
            return code, None if code else self._to_python(raw)
        finally:
            self._destroy(raw)


_KINDS: Final[dict[Any, _Kind]] = {}


def _kind(kind: Any) -> _Kind:
    if kind not in _KINDS:
        kind.__class__.__import_type_support__()
        _KINDS[kind] = _Kind(kind)
    return _KINDS[kind]


def _address(capsule: object) -> int:
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    return int(get(capsule, None))


def _function(library: ctypes.CDLL, name: str, arguments: int) -> Any:
    function = getattr(library, name)
    function.restype, function.argtypes = ctypes.c_int, (ctypes.c_void_p,) * arguments
    return function


_publish = _function(_RCL, "rcl_publish", 3)
_take_request = _function(_RCL, "rcl_take_request_with_info", 3)
_send_response = _function(_RCL, "rcl_send_response", 3)
_get_statuses = _function(_RCL_ACTION, "rcl_action_get_goal_status_array", 2)
_publish_status = _function(_RCL_ACTION, "rcl_action_publish_status", 2)
_publish_feedback = _function(_RCL_ACTION, "rcl_action_publish_feedback", 2)
_end_statuses = _function(_RCL_ACTION, "rcl_action_goal_status_array_fini", 1)


def _check(code: int, what: str) -> None:
    if code:
        raise rclpy_implementation.RCLError(f"could not {what}: {_said()}")


def _said() -> str:
    text = _RCUTILS.rcutils_get_error_string().text.decode(errors="replace")
    _RCUTILS.rcutils_reset_error()
    return str(text)


def _publisher_publish(publisher: Any, message: Any) -> None:
    pointer = publisher.pointer
    _check(_kind(type(message)).sent(message, lambda raw: int(_publish(pointer, raw, None))), "publish")


def _service_take_request(service: Any, kind: Any) -> tuple[Any, _ServiceInfo | None]:
    info, pointer = _ServiceInfo(), service.pointer
    code, request = _kind(kind).taken(lambda raw: int(_take_request(pointer, ctypes.byref(info), raw)))
    if code in _NOTHING_TAKEN:
        return None, None
    _check(code, "take a request")
    return request, info


def _service_send_response(service: Service, response: Any, info: _ServiceInfo) -> None:
    if not isinstance(response, service.srv_type.Response):
        raise TypeError(f"{service.srv_name} answers {service.srv_type.__name__}.Response, not {type(response)}")
    with service.handle:
        pointer, to = service.handle.pointer, ctypes.byref(info.request_id)
        code = _kind(type(response)).sent(response, lambda raw: int(_send_response(pointer, to, raw)))
    if code == _TIMEOUT:
        why = "it has left, or listens with qualities of service that do not fit"
        LOG.warning("%s: a client could not be answered: %s (%s)", service.srv_name, why, _said())
        return
    _check(code, f"answer on {service.srv_name}")


def _server_take(name: str) -> Callable[[Any, Any], tuple[_RequestId | None, Any]]:
    function = _function(_RCL_ACTION, f"rcl_action_take_{name}_request", 3)

    def take(server: Any, kind: Any) -> tuple[_RequestId | None, Any]:
        request_id, pointer = _RequestId(), server.pointer
        code, request = _kind(kind).taken(lambda raw: int(function(pointer, ctypes.byref(request_id), raw)))
        if code in _NOTHING_TAKEN:
            return None, None
        _check(code, f"take a {name} request")
        return request_id, request

    return take


def _server_send(name: str) -> Callable[[Any, _RequestId, Any], None]:
    function = _function(_RCL_ACTION, f"rcl_action_send_{name}_response", 3)

    def send(server: Any, request_id: _RequestId, response: Any) -> None:
        pointer, to = server.pointer, ctypes.byref(request_id)
        code = _kind(type(response)).sent(response, lambda raw: int(function(pointer, to, raw)))
        _check(code, f"send a {name} response")

    return send


def _server_publish_feedback(server: Any, message: Any) -> None:
    pointer = server.pointer
    code = _kind(type(message)).sent(message, lambda raw: int(_publish_feedback(pointer, raw)))
    _check(code, "publish feedback")


def _server_publish_status(server: Any) -> None:
    statuses = _GoalStatuses()
    _check(_get_statuses(server.pointer, ctypes.byref(statuses)), "get the goals' status")
    try:
        _check(_publish_status(server.pointer, ctypes.byref(statuses)), "publish the goals' status")
    finally:
        _end_statuses(ctypes.byref(statuses))


REPLACED: Final[tuple[tuple[Any, str, Any], ...]] = (
    (rclpy_implementation.Publisher, "publish", _publisher_publish),
    (rclpy_implementation.Service, "service_take_request", _service_take_request),
    (Service, "send_response", _service_send_response),
    *(
        (rclpy_implementation.ActionServer, f"take_{name}_request", _server_take(name))
        for name in ("goal", "cancel", "result")
    ),
    *(
        (rclpy_implementation.ActionServer, f"send_{name}_response", _server_send(name))
        for name in ("goal", "cancel", "result")
    ),
    (rclpy_implementation.ActionServer, "publish_feedback", _server_publish_feedback),
    (rclpy_implementation.ActionServer, "publish_status", _server_publish_status),
)
"""Whose method of which name is replaced by what."""


def leave_the_lock_to_others() -> None:
    """From now on, in this whole process."""
    for owner, name, function in REPLACED:
        setattr(owner, name, function)
