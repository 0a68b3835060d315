"""A client that sets parameters receives a result for each of them, without a traceback."""

from typing import Any

import pytest

pytest.importorskip("rclpy")

from rcl_interfaces.msg import Parameter, ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically

from nodes.set_parameters import answering

GOOD = Parameter(name="good", value=ParameterValue(type=3, double_value=1.0))
STRANGE = Parameter(name="strange", value=ParameterValue(type=77))
FAILING = Parameter(name="failing", value=ParameterValue(type=3))
WHY = "parameter 'strange' cannot be set because its type 77 does not exist: use 0 to 9"


def setting(request: Any, response: Any) -> Any:
    """Respond as rclpy does, with one result per parameter or one result for all parameters."""
    if any(parameter.name == "failing" for parameter in request.parameters):
        raise ZeroDivisionError("a plugin's")
    result = SetParametersResult(successful=True)
    if isinstance(response, SetParameters.Response):
        response.results = [result] * len(request.parameters)
    else:
        response.result = result
    return response


def test_valid_parameters_of_a_call_are_set(caplog: pytest.LogCaptureFixture) -> None:
    request = SetParameters.Request(parameters=[STRANGE, GOOD, FAILING, GOOD])
    results = answering(SetParameters, setting)(request, SetParameters.Response()).results
    assert [result.successful for result in results] == [False, True, False, True]
    assert results[0].reason == WHY and "a plugin's" in results[2].reason
    assert "Traceback" not in caplog.text


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ([GOOD], ""),
        ([], ""),
        ([GOOD, STRANGE], WHY),
        ([FAILING], "parameter 'failing' cannot be set: a plugin's"),
    ],
)
def test_atomic_call_sets_all_parameters_or_none(parameters: list[Parameter], reason: str) -> None:
    request = SetParametersAtomically.Request(parameters=parameters)
    result = answering(SetParametersAtomically, setting)(request, SetParametersAtomically.Response()).result
    assert (result.successful, result.reason) == (not reason, reason)


def test_other_services_are_not_wrapped() -> None:
    assert answering(GetParameters, setting) is setting
