"""Call functions of rcl through ctypes, because ctypes releases the GIL. gil_release.py installs these functions in
rclpy.

The layouts come from rmw/types.h and action_msgs/msg/detail/goal_status_array__struct.h of Jazzy. Only gil_release.py
may import this module, because the import opens the C libraries and resolves their functions.
"""

import ctypes
import logging
import sys
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from time import monotonic
from typing import Any, Final

from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.service import Service

from nodes.rclpy_patches.client_limits import CLIENT_LIMITS
from nodes.rclpy_patches.message_size import capsule_address, layout_of

LOG = logging.getLogger("servoloop.nodes")

_TIMEOUT: Final = 2  # RCL_RET_TIMEOUT of rcl/types.h
_NOTHING_TAKEN: Final = (401, 601, 2201)  # RCL_RET_{SUBSCRIPTION,SERVICE,ACTION_SERVER}_TAKE_FAILED

TOO_LARGE, TOO_OFTEN = object(), object()
"""Placeholders for messages that exceed a limit and were not converted to Python."""
MOST_REFUSED: Final = 50
"""Maximum number of requests rejected in one call, before other clients are served."""
_MESSAGE_INFO: Final = (
    "source_timestamp",
    "received_timestamp",
    "publication_sequence_number",
    "reception_sequence_number",
)
_UNKNOWN: Final = 2**64 - 1  # RMW_MESSAGE_INFO_SEQUENCE_NUMBER_UNSUPPORTED
_TAKE_MESSAGE: Final = rclpy_implementation.Subscription.take_message

_RCL: Final = ctypes.CDLL("librcl.so")
_RCL_ACTION: Final = ctypes.CDLL("librcl_action.so")
_RCUTILS: Final = ctypes.CDLL("librcutils.so")


class _RequestId(ctypes.Structure):
    """C structure rmw_request_id_t, which identifies the client that sent a request."""

    _fields_ = (("writer_guid", ctypes.c_uint8 * 16), ("sequence_number", ctypes.c_int64))


class _ServiceInfo(ctypes.Structure):
    """C structure rmw_service_info_t."""

    _fields_ = (("sent_ns", ctypes.c_int64), ("received_ns", ctypes.c_int64), ("request_id", _RequestId))


class _MessageInfo(ctypes.Structure):
    """C structure rmw_message_info_t."""

    _fields_ = (
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("publication_sequence_number", ctypes.c_uint64),
        ("reception_sequence_number", ctypes.c_uint64),
        ("publisher", ctypes.c_uint8 * 32),
    )


class GoalStatuses(ctypes.Structure):
    """C structure rcl_action_goal_status_array_t: a sequence and an rcutils_allocator_t."""

    _fields_ = (("sequence", ctypes.c_void_p * 3), ("allocator", ctypes.c_void_p * 5))


class _ErrorText(ctypes.Structure):
    """C structure rcutils_error_string_t."""

    _fields_ = (("text", ctypes.c_char * 1024),)


_RCUTILS.rcutils_get_error_string.restype = _ErrorText


class _Kind:
    """Functions of a message type that convert messages to C and back. These functions hold the GIL."""

    def __init__(self, kind: Any) -> None:
        self._create = ctypes.PYFUNCTYPE(ctypes.c_void_p)(capsule_address(kind._CREATE_ROS_MESSAGE))
        self._destroy = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(capsule_address(kind._DESTROY_ROS_MESSAGE))
        self._from_python = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, ctypes.c_void_p)(
            capsule_address(kind._CONVERT_FROM_PY)
        )
        self._to_python = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)(capsule_address(kind._CONVERT_TO_PY))
        self._layout = layout_of(kind)

    def sent(self, message: Any, send: Callable[[int], int]) -> int:
        """Convert a message to C, pass it to ``send`` and return the return code."""
        raw = self._create()
        try:
            self._from_python(message, raw)  # The conversion fails if the message is invalid.
            return send(raw)
        finally:
            self._destroy(raw)

    def taken(self, take: Callable[[int], int], refuses: Callable[[], bool] | None = None) -> tuple[int, Any]:
        """Take a message and convert it to Python.

        Args:
            take: Function that fills in a C message and returns a return code.
            refuses: Function that returns whether messages arrive too frequently.

        Returns:
            The return code and the message. The message is None after an error, and TOO_LARGE or TOO_OFTEN if it
            exceeds a limit.
        """
        raw = self._create()
        try:
            code, allowed = take(raw), CLIENT_LIMITS.bytes
            if code:
                return code, None
            if refuses is not None and refuses():
                return code, TOO_OFTEN
            return code, TOO_LARGE if self._layout.measured(raw, allowed) > allowed else self._to_python(raw)
        finally:
            self._destroy(raw)


_DELAYED: Final[dict[int, Any]] = {}
"""Action servers whose status publication is delayed, keyed by their pointers."""
_KINDS: Final[dict[Any, _Kind]] = {}


def _kind(kind: Any) -> _Kind:
    if kind not in _KINDS:
        kind.__class__.__import_type_support__()
        _KINDS[kind] = _Kind(kind)
    return _KINDS[kind]


def _function(library: ctypes.CDLL, name: str, arguments: int) -> Any:
    function = getattr(library, name)
    function.restype, function.argtypes = ctypes.c_int, (ctypes.c_void_p,) * arguments
    return function


def _name(library: ctypes.CDLL, name: str) -> Any:
    """Return a function that returns the name of an entity, given its pointer."""
    function = getattr(library, name)
    function.restype, function.argtypes = ctypes.c_char_p, (ctypes.c_void_p,)
    return lambda pointer: (function(pointer) or b"?").decode(errors="replace")


_topic_name = _name(_RCL, "rcl_subscription_get_topic_name")
_service_name = _name(_RCL, "rcl_service_get_service_name")
_take = _function(_RCL, "rcl_take", 4)
_publish = _function(_RCL, "rcl_publish", 3)
_take_request = _function(_RCL, "rcl_take_request_with_info", 3)
_send_response = _function(_RCL, "rcl_send_response", 3)
_get_statuses = _function(_RCL_ACTION, "rcl_action_get_goal_status_array", 2)
_publish_status = _function(_RCL_ACTION, "rcl_action_publish_status", 2)
_publish_feedback = _function(_RCL_ACTION, "rcl_action_publish_feedback", 2)
_end_statuses = _function(_RCL_ACTION, "rcl_action_goal_status_array_fini", 1)


def _check(code: int, what: str) -> None:
    if code:
        raise rclpy_implementation.RCLError(f"could not {what}: {_error_text()}")


def _error_text() -> str:
    text = _RCUTILS.rcutils_get_error_string().text.decode(errors="replace")
    _RCUTILS.rcutils_reset_error()
    return str(text)


def publisher_publish(publisher: Any, message: Any) -> None:
    pointer = publisher.pointer
    _check(_kind(type(message)).sent(message, lambda raw: int(_publish(pointer, raw, None))), "publish")


def subscription_take(subscription: Any, kind: Any, raw: bool) -> tuple[Any, dict[str, int | None]] | None:
    if raw:
        found: tuple[Any, dict[str, int | None]] | None = _TAKE_MESSAGE(subscription, kind, raw)
        return found
    info, pointer = _MessageInfo(), subscription.pointer
    code, message = _kind(kind).taken(lambda address: int(_take(pointer, address, ctypes.byref(info), None)))
    if code in _NOTHING_TAKEN:
        return None
    _check(code, "take a message")
    if message is TOO_LARGE:
        CLIENT_LIMITS.refuse_size(_topic_name(pointer))
        return None
    numbers = {name: int(getattr(info, name)) for name in _MESSAGE_INFO}
    return message, {name: None if number == _UNKNOWN else number for name, number in numbers.items()}


def service_take_request(service: Any, kind: Any) -> tuple[Any, _ServiceInfo | None]:
    info, pointer = _ServiceInfo(), service.pointer
    code, request = _kind(kind).taken(lambda raw: int(_take_request(pointer, ctypes.byref(info), raw)))
    if code in _NOTHING_TAKEN:
        return None, None
    _check(code, "take a request")
    if request is TOO_LARGE:
        CLIENT_LIMITS.refuse_size(_service_name(pointer))
        _answer_empty(kind, lambda raw: int(_send_response(pointer, ctypes.byref(info.request_id), raw)))
        return None, None
    return request, info


def _answer_empty(kind: Any, send: Callable[[int], int]) -> None:
    """Send a default response to a request that was not read. The default values mean "not ok" or "not accepted"."""
    response = getattr(sys.modules[kind.__module__], kind.__name__.removesuffix("Request") + "Response")
    if _kind(response).sent(response(), send):
        LOG.warning("no response could be sent to a client whose message is too large: %s", _error_text())


def service_send_response(service: Service, response: Any, info: _ServiceInfo) -> None:
    if not isinstance(response, service.srv_type.Response):
        raise TypeError(f"{service.srv_name} needs a {service.srv_type.__name__}.Response, not {type(response)}")
    with service.handle:
        pointer, to = service.handle.pointer, ctypes.byref(info.request_id)
        code = _kind(type(response)).sent(response, lambda raw: int(_send_response(pointer, to, raw)))
    if code == _TIMEOUT:
        reason = "it has left, or its QoS is incompatible"
        LOG.warning("%s: no response could be sent to a client: %s (%s)", service.srv_name, reason, _error_text())
        return
    _check(code, f"send a response on {service.srv_name}")


def server_take(name: str) -> Callable[[Any, Any], tuple[_RequestId | None, Any]]:
    function = _function(_RCL_ACTION, f"rcl_action_take_{name}_request", 3)
    answer = _function(_RCL_ACTION, f"rcl_action_send_{name}_response", 3)

    def take(server: Any, kind: Any) -> tuple[_RequestId | None, Any]:
        """Take the first request that is within the limits."""
        pointer = server.pointer
        for _ in range(MOST_REFUSED):
            request_id = _RequestId()
            take_into = partial(_taken_by, function, pointer, request_id)
            refuses = partial(_is_too_frequent, request_id) if name == "goal" else None
            code, request = _kind(kind).taken(take_into, refuses)
            if code in _NOTHING_TAKEN:
                return None, None
            _check(code, f"take a {name} request")
            if request is not TOO_LARGE and request is not TOO_OFTEN:
                return request_id, request
            action = CLIENT_LIMITS.actions.get(pointer, "an action")
            refusal = _Refusal(server, kind, request_id, answer)
            if request is TOO_LARGE:
                CLIENT_LIMITS.refuse_size(action)
                refusal.send()
            else:
                CLIENT_LIMITS.refuse_rate(action)
                _REFUSALS.append(refusal)
        return None, None

    return take


def _taken_by(function: Any, pointer: int, request_id: _RequestId, raw: int) -> int:
    return int(function(pointer, ctypes.byref(request_id), raw))


@dataclass(frozen=True, slots=True)
class _Refusal:
    """Pending rejection of a request that was not read."""

    server: Any
    kind: Any
    request_id: _RequestId
    answer: Any

    def send(self) -> None:
        pointer, to = self.server.pointer, ctypes.byref(self.request_id)
        _answer_empty(self.kind, lambda raw: int(self.answer(pointer, to, raw)))


_REFUSALS: Final[deque[_Refusal]] = deque(maxlen=10_000)
"""Pending rejections, sent at a limited rate. Every client receives all responses, and most clients queue only ten
responses."""


def send_refusals() -> None:
    """Send the pending rejections that the rate limit allows. This function must be called often."""
    while _REFUSALS and CLIENT_LIMITS.refusals.allows("all", monotonic()):
        with suppress(InvalidHandle):  # The controller was unloaded.
            _REFUSALS.popleft().send()


def _is_too_frequent(request_id: _RequestId) -> bool:
    return not CLIENT_LIMITS.goals.allows(bytes(request_id.writer_guid), monotonic())


def server_send(name: str) -> Callable[[Any, _RequestId, Any], None]:
    function = _function(_RCL_ACTION, f"rcl_action_send_{name}_response", 3)

    def send(server: Any, request_id: _RequestId, response: Any) -> None:
        pointer, to = server.pointer, ctypes.byref(request_id)
        code = _kind(type(response)).sent(response, lambda raw: int(function(pointer, to, raw)))
        _check(code, f"send a {name} response")

    return send


def server_publish_feedback(server: Any, message: Any) -> None:
    pointer = server.pointer
    code = _kind(type(message)).sent(message, lambda raw: int(_publish_feedback(pointer, raw)))
    _check(code, "publish feedback")


def server_publish_status(server: Any) -> None:
    """Publish the goal status now if the rate limit allows it. Otherwise, publish the latest status later."""
    if CLIENT_LIMITS.statuses.allows(server.pointer, monotonic()):
        _DELAYED.pop(server.pointer, None)
        _publish_status_now(server)
    else:
        _DELAYED[server.pointer] = server


def publish_waiting_statuses() -> None:
    """Publish the delayed statuses that the rate limit allows. This function must be called in every cycle."""
    for pointer, server in list(_DELAYED.items()):
        try:
            server_publish_status(server)
        except (InvalidHandle, rclpy_implementation.RCLError):  # The controller has been unloaded.
            _DELAYED.pop(pointer, None)


def _publish_status_now(server: Any) -> None:
    statuses = GoalStatuses()
    _check(_get_statuses(server.pointer, ctypes.byref(statuses)), "get the goals' status")
    try:
        _check(_publish_status(server.pointer, ctypes.byref(statuses)), "publish the goals' status")
    finally:
        _end_statuses(ctypes.byref(statuses))


def written_by_zero_initialized_goal_statuses() -> int:
    """Return the size of rcl's goal status array in bytes. The function requires x86_64, where such structures are
    returned by pointer."""
    untouched = 0xA5
    buffer = (ctypes.c_ubyte * 4096)(*[untouched] * 4096)
    _function(_RCL_ACTION, "rcl_action_get_zero_initialized_goal_status_array", 1)(buffer)
    return max((index + 1 for index, byte in enumerate(buffer) if byte != untouched), default=0)
