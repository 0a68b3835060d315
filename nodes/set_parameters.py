"""Respond to every call that sets parameters, even if rclpy raises an error."""

import logging
from collections.abc import Callable
from typing import Any, Final

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from drivers.printable import printable

LOG = logging.getLogger("servoloop.nodes")

Callback = Callable[[Any, Any], Any]
_TYPES: Final = {kind.value for kind in Parameter.Type}


def answering(kind: Any, callback: Callback) -> Callback:
    """Wrap the callback of a service that sets parameters, so that the service always responds. Callbacks of other
    services are returned unchanged.

    rclpy's callback raises an error if a value's type does not exist or if a plugin's callback fails. In both cases,
    the client would not receive a response.
    """
    if kind is SetParameters:
        return lambda request, response: _each(callback, request, response)
    if kind is SetParametersAtomically:
        return lambda request, response: _together(callback, request, response)
    return callback


def _each(callback: Callback, request: Any, response: Any) -> Any:
    for parameter in request.parameters:
        reason = _mistake(parameter)
        if not reason:
            try:
                one = callback(SetParameters.Request(parameters=[parameter]), SetParameters.Response())
                response.results.append(one.results[0])
                continue
            except Exception as error:  # A plugin's callback may raise any exception.
                reason = _failed(parameter, error)
        response.results.append(SetParametersResult(successful=False, reason=reason))
    return response


def _together(callback: Callback, request: Any, response: Any) -> Any:
    reason = next(filter(None, map(_mistake, request.parameters)), "")
    if not reason:
        try:
            return callback(request, response)
        except Exception as error:  # A plugin's callback may raise any exception.
            reason = _failed(request.parameters[0], error) if request.parameters else str(error)
    response.result = SetParametersResult(successful=False, reason=reason)
    return response


def _mistake(parameter: ParameterMessage) -> str:
    kind = parameter.value.type
    known = f"{min(_TYPES)} to {max(_TYPES)}"
    named = f"parameter '{printable(parameter.name)}'"
    return "" if kind in _TYPES else f"{named} cannot be set because its type {kind} does not exist: use {known}"


def _failed(parameter: ParameterMessage, error: Exception) -> str:
    LOG.error("parameter '%s' was not set: %s: %s", parameter.name, type(error).__name__, error)
    return f"parameter '{printable(parameter.name)}' cannot be set: {error}"
